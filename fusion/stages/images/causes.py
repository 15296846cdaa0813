"""Why an image does not look like the shape at its state: which other state it does look like."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from fusion.stages.images.record import ImageRecord
from fusion.stages.images.triage_report import Likely
from fusion.stages.images.turns import Turn
from fusion.workspace import Workspace
from spcola.arrays import AnyArray
from spcola.camera import SpcImage
from spcola.errors import WorkspaceError
from spcola.formats.images import read_image_data
from spcola.imagematching.frames import (
    FrameMatch,
    RenderedFrame,
    View,
    compare_frame,
    correlation_beyond,
    render_frame,
)
from spcola.imagematching.frames.mistakes import BodyOutline, Mistake
from spcola.shape import RayCaster

# Cells along the longer side of a frame, and the share of it that an image may be displaced.
COARSE = 128
_REACH = 1.0 / 16.0
# A cause must explain the picture: by this correlation, and this much better than what is given
# and than the next cause.
_FITS, _BETTER, _CLEARLY = 0.5, 0.1, 0.03
# With more of the frame covered by the body, its limb is too short to determine an offset.
MOST_OF_FRAME = 0.9
# So far from the best offset, as a share of the frame, the correlation must be lower by this much;
# by more without a limb, as ground of one slope looks alike everywhere.
_ELSEWHERE, _DISTINCT_LIMB, _DISTINCT = 0.125, 0.035, 0.15
# So many images before and after are tried whose states may have been exchanged.
_NEAR = 6


def pixels_of(workspace: Workspace, record: ImageRecord) -> AnyArray:
    """Return the pixels (lines, samples) of an image of the catalogue.

    Raises
    ------
    WorkspaceError
        If they are not there.
    """
    path = workspace.exposure_path(record.name)
    if not path.is_file():
        raise WorkspaceError(
            "is not there, though the catalogue lists it", path, "import the image again"
        )
    return read_image_data(path, *record.size)


def step_of(size: tuple[int, int], cells: int) -> int:
    """Return pixels along a side of a cell, with `cells` along the longer side of a frame."""
    return max(1, -(-max(size) // cells))


def reach_of(size: tuple[int, int]) -> float:
    """Return how many pixels an image may be displaced from its state."""
    return _REACH * max(size)


def match_frame(image: View, dn: AnyArray, rendered: RenderedFrame) -> FrameMatch:
    """Compare pixels with a rendering."""
    return compare_frame(
        np.ascontiguousarray(dn),
        rendered,
        lowest=float(image.thresholds[0]),
        reach_px=reach_of(image.size),
    )


def is_distinct(dn: AnyArray, rendered: RenderedFrame, match: FrameMatch) -> bool:
    """Return whether a picture fits a rendering at its best offset much better than far from it."""
    elsewhere = correlation_beyond(
        np.ascontiguousarray(dn), rendered, match.offset, distance_px=_ELSEWHERE * max(dn.shape)
    )
    limb = rendered.body.mean() < MOST_OF_FRAME
    return match.correlation - elsewhere >= (_DISTINCT_LIMB if limb else _DISTINCT)


def better_turn(
    image: View, dn: AnyArray, rendered: RenderedFrame, match: FrameMatch
) -> Turn | None:
    """Return the orientation in which pixels fit a rendering clearly better than as stored.

    Parameters
    ----------
    image : SpcImage
    dn : (NLN, NPX) ndarray
    rendered : RenderedFrame
    match : FrameMatch
        Of the pixels as they are stored.
    """
    turns = [turn for turn in Turn if turn is not Turn.AS_STORED]
    if image.size[0] != image.size[1]:
        turns = [turn for turn in turns if not turn.exchanges]
    found = {turn: match_frame(image, turn.orientation.apply(dn), rendered) for turn in turns}
    best = max(turns, key=lambda turn: found[turn].correlation)
    better = found[best].correlation >= max(_FITS, match.correlation + _CLEARLY)
    distinct = better and is_distinct(best.orientation.apply(dn), rendered, found[best])
    return best if distinct else None


@dataclass(frozen=True, eq=False)
class CauseSearch:
    """Search for states that an image looks like.

    Parameters
    ----------
    workspace : Workspace
    caster : RayCaster
    """

    workspace: Workspace
    caster: RayCaster

    def mistake(self, record: ImageRecord, image: SpcImage, given: float) -> Likely | None:
        """Return the mistake without which the image fits its state; None if none stands out.

        Parameters
        ----------
        record : ImageRecord
        image : SpcImage
        given : float
            Best correlation at the given state, in any orientation.
        """
        outline = BodyOutline.of_mesh(self.caster.mesh)
        tried = {one: one.mended(image) for one in outline.mistakes(image)}
        found = self._scores(record, {str(one): other for one, other in tried.items()})
        best = _standing_out(found, given)
        return None if best is None else Likely(Mistake(best).value, found[best])

    def other_image(
        self, record: ImageRecord, image: SpcImage, given: float, others: Mapping[str, SpcImage]
    ) -> Likely | None:
        """Return the image whose state this one fits; None if none stands out.

        Parameters
        ----------
        record : ImageRecord
        image : SpcImage
        given : float
        others : mapping of str to SpcImage
            By their names.
        """
        states = {
            name: replace(image, scobj=one.scobj, axes=one.axes, sun=one.sun)
            for name, one in others.items()
        }
        found = self._scores(record, states)
        best = _standing_out(found, given)
        return None if best is None else Likely("other-image", found[best], best)

    def _scores(self, record: ImageRecord, states: Mapping[str, SpcImage]) -> dict[str, float]:
        """Return the correlation of an image with the shape at other states.

        0 where it fits far from the state, or as well elsewhere: one mistake does not explain it.
        """
        dn = pixels_of(self.workspace, record)
        step = step_of(record.size, COARSE)
        found = {}
        for name, state in states.items():
            rendered = render_frame(self.caster, state, step=step)
            if rendered.body.any():
                match = match_frame(state, dn, rendered)
                near = max(map(abs, match.offset)) <= reach_of(record.size)
                explains = near and is_distinct(dn, rendered, match)
                found[name] = match.correlation if explains else 0.0
        return found


def near(names: Iterable[str], times: Mapping[str, float]) -> dict[str, list[str]]:
    """Return for each image those whose times are next to its own."""
    ordered = sorted(names, key=times.__getitem__)
    return {
        name: ordered[max(place - _NEAR, 0) : place] + ordered[place + 1 : place + 1 + _NEAR]
        for place, name in enumerate(ordered)
    }


def _standing_out(scores: Mapping[str, float], given: float) -> str | None:
    """Return the best of correlations if it is clearly better than the others and the given one."""
    ordered = sorted(scores, key=lambda name: -scores[name])
    if not ordered or scores[ordered[0]] < max(_FITS, given + _BETTER):
        return None
    if len(ordered) > 1 and scores[ordered[0]] - scores[ordered[1]] < _CLEARLY:
        return None
    return ordered[0]
