"""What an image shows, and whether it fits its state: triage of the images of a workspace."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from fusion.pipeline.items import ItemStore
from fusion.runtime import Executor, Progress
from fusion.stages.images.catalogue import catalogue_path, read_catalogue
from fusion.stages.images.importing import ITEM_PLACE, ITEM_VERSION
from fusion.stages.images.pixels import file_digest
from fusion.stages.images.record import ImageRecord
from fusion.stages.images.turns import Turn
from fusion.workspace import Workspace
from spcola.camera import SpcImage
from spcola.errors import WorkspaceError
from spcola.formats.images import read_image_data
from spcola.imagematching.frames import (
    FrameMatch,
    RenderedFrame,
    center_view,
    compare_frame,
    render_frame,
)
from spcola.shape import RayCaster

__all__ = ["Fit", "Flag", "Scene", "Triage", "TriageReport", "triage_images"]
# Cells along the longer side of a frame: to find the orientation, and then the offset.
_COARSE, _FINE = 128, 256
_REACH = 1.0 / 16.0
_FEWEST_LIT, _MOST_LIT = 5e-4, 0.995
_LEAST_BODY = 1e-3
_OVEREXPOSED, _SMEARED, _NOISE = 0.01, 0.05, 0.2
_FITS, _CLEARLY = 0.5, 0.05
_MOST_OF_FRAME, _ALIKE = 0.9, 0.7
# Offsets beyond this share of the frame are named.
_FAR = 0.03


class Scene(StrEnum):
    """What is in the frame."""

    NO_BODY = "no body"
    LIMB = "limb"
    FILLED = "filled"


class Flag(StrEnum):
    """Why an image is doubtful."""

    EMPTY = "empty"
    OVEREXPOSED = "overexposed"
    SMEARED = "smeared"
    MIRRORED = "mirrored"
    TURNED = "turned"
    OFFSET = "offset"
    UNMATCHED = "unmatched"
    NO_STATE = "no state"


@dataclass(frozen=True)
class Fit:
    """An image against the shape at its state.

    Parameters
    ----------
    turn : Turn or None
        The orientation in which the image fits; None if none fits clearly better than the others.
    correlation, given, runner_up : float
        In the best orientation at the best offset; as it is, without an offset; in the best of the
        other orientations.
    offset_px : (2,) of float
        Pixel and line by which the image lies beside the rendering.
    overlap, overlap_given : float
        Intersection over union of the lit ground, at the best offset and without one.
    """

    turn: Turn | None
    correlation: float
    given: float
    runner_up: float
    offset_px: tuple[float, float]
    overlap: float
    overlap_given: float


@dataclass(frozen=True)
class Triage:
    """What an image shows.

    Parameters
    ----------
    name : str
    original : str
    size : (2,) of int
        Samples and lines.
    scene : Scene
    body_share : float
        Share of the frame that shows the body: by shape and state, NaN without them.
    lit_share : float
        Share of pixels of lit ground.
    range_m, resolution_m : float
        At the frame's centre; NaN without a state.
    phase_deg, emission_deg : float
        At the frame's centre; NaN where unknown.
    fit : Fit, optional
        Where there are state and shape, and the body is in the frame.
    flags : tuple of Flag
    """

    name: str
    original: str
    size: tuple[int, int]
    scene: Scene
    body_share: float
    lit_share: float
    range_m: float
    resolution_m: float
    phase_deg: float
    emission_deg: float
    fit: Fit | None
    flags: tuple[Flag, ...]

    def as_json(self) -> dict[str, Any]:
        """Return the triage in JSON types."""
        return asdict(self)

    @property
    def remark(self) -> str:
        """What is doubtful, and what to do, on one line; empty if nothing is."""
        words = [_WORDS[flag] for flag in self.flags]
        return "; ".join(one if isinstance(one, str) else one(self) for one in words)


def _turn_words(triage: Triage) -> str:
    assert triage.fit is not None
    assert triage.fit.turn is not None
    what = "is mirrored" if Flag.MIRRORED in triage.flags else "is turned"
    return (
        f"{what} against its state (correlation {triage.fit.correlation:.2f} as "
        f"{triage.fit.turn}, {triage.fit.given:.2f} as it is): remove its files and import it "
        f"with --orientation {triage.fit.turn}, or mend the state"
    )


def _offset_words(triage: Triage) -> str:
    assert triage.fit is not None
    right, down = triage.fit.offset_px
    return f"lies {right:+.1f} pixels and {down:+.1f} lines beside the shape at its state"


_WORDS: dict[Flag, str | Callable[[Triage], str]] = {
    Flag.EMPTY: "shows noise alone",
    Flag.OVEREXPOSED: "is overexposed",
    Flag.SMEARED: "has smear along whole columns or lines",
    Flag.MIRRORED: _turn_words,
    Flag.TURNED: _turn_words,
    Flag.OFFSET: _offset_words,
    Flag.UNMATCHED: "looks like the shape at its state in no orientation, or in several alike",
    Flag.NO_STATE: "has no state: give --poses or --states",
}


@dataclass(frozen=True)
class TriageReport:
    """Triage of all images of a workspace.

    Parameters
    ----------
    images : tuple of Triage
        In the order of their names.
    """

    images: tuple[Triage, ...]

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of images by scene and by flag."""
        counts = {str(scene): sum(one.scene is scene for one in self.images) for scene in Scene}
        return counts | {str(flag): sum(flag in one.flags for one in self.images) for flag in Flag}

    @property
    def found_orientation(self) -> dict[str, int]:
        """Numbers of images by the orientation in which they fit the shape."""
        turns = [str(one.fit.turn) for one in self.images if one.fit and one.fit.turn]
        return {turn: turns.count(turn) for turn in sorted(set(turns))}

    @property
    def offset_rms_px(self) -> tuple[float, float]:
        """Root mean square of the offsets of images with an orientation, pixel and line."""
        offsets = [one.fit.offset_px for one in self.images if one.fit and one.fit.turn]
        if not offsets:
            return np.nan, np.nan
        right, down = np.sqrt(np.mean(np.square(offsets), axis=0))
        return float(right), float(down)

    def as_json(self) -> dict[str, Any]:
        """Return the report in JSON types."""
        return {
            "counts": self.counts,
            "orientations": self.found_orientation,
            "offset_rms_px": list(self.offset_rms_px),
            "images": [one.as_json() for one in self.images],
        }


def triage_images(
    workspace: Workspace, *, executor: Executor, progress: Progress | None = None
) -> TriageReport:
    """Return what the images of a workspace's catalogue show.

    Each result is kept as an item: what did not change is not looked at again.

    Parameters
    ----------
    workspace : Workspace
        States and shape are those of its solution.
    executor : Executor
    progress : Progress, optional

    Raises
    ------
    WorkspaceError
        If there is no image, or the pixels of one are not there.
    """
    records = read_catalogue(workspace)
    if not records:
        raise WorkspaceError(
            "lists no image",
            catalogue_path(workspace),
            f"run: spcola images {workspace.root} FILE...",
        )
    shape = workspace.shape_path() if workspace.has_shape() else None
    caster = None if shape is None else RayCaster(workspace.shape())
    digest = "" if shape is None else file_digest(shape)
    sizes = [float(one.size[0] * one.size[1]) for one in records.values()]
    store = ItemStore(workspace.home / ITEM_PLACE.with_name("triage"), ITEM_VERSION)
    begun = time.time()
    work = _Work(workspace, caster, digest, store)
    found = []
    with (progress or Progress()).items("triage", sizes, executor.workers) as task:
        for seconds, one in executor.stream(
            work.timed, [records[name] for name in sorted(records)]
        ):
            found.append(one)
            task.advance_one(seconds)
    store.remove_unused(begun)
    return TriageReport(tuple(found))


@dataclass(frozen=True, eq=False)
class _Work:
    """Triage of one image after another."""

    workspace: Workspace
    caster: RayCaster | None
    shape: str
    store: ItemStore

    def timed(self, record: ImageRecord) -> tuple[float, Triage]:
        """Return seconds and result."""
        begun = time.perf_counter()
        path = self.workspace.image_path(record.name)
        state = file_digest(path) if path.is_file() else ""
        image = self.workspace.image(record.name) if state else None

        def triage(_record: ImageRecord, _state: str, _shape: str) -> Triage:
            return _triage(record, image, self.caster, self.workspace)

        result = self.store.result(triage, record, state, self.shape)
        return time.perf_counter() - begun, result


def _triage(
    record: ImageRecord, image: SpcImage | None, caster: RayCaster | None, workspace: Workspace
) -> Triage:
    """Look at one image."""
    flags = _pixel_flags(record)
    scene, share, fit = _scene_of_pixels(record), np.nan, None
    if image is None:
        flags.append(Flag.NO_STATE)
        nan = np.nan
        return Triage(
            record.name, record.original, record.size, scene, share, record.pixels.lit,
            nan, nan, nan, nan, None, tuple(flags),
        )  # fmt: skip
    view = center_view(caster, image)
    if caster is not None:
        rendered = render_frame(caster, image, step=_step(record, _COARSE))
        share = float(rendered.body.mean())
        if Flag.EMPTY not in flags:
            scene = _scene(share)
        if share >= _LEAST_BODY and Flag.EMPTY not in flags:
            fit = _fit(record, image, caster, rendered, workspace)
            flags += _fit_flags(record, fit, share)
    phase, emission = np.degrees([view.phase, view.emission])
    return Triage(
        record.name, record.original, record.size, scene, share, record.pixels.lit, view.range_m,
        view.resolution_m, float(phase), float(emission), fit, tuple(flags),
    )  # fmt: skip


def _pixel_flags(record: ImageRecord) -> list[Flag]:
    """Return what the pixels alone show."""
    pixels = record.pixels
    count = record.size[0] * record.size[1]
    found = {
        Flag.EMPTY: pixels.lit == 0.0 or pixels.likeness < _NOISE,
        Flag.OVEREXPOSED: max(pixels.brightest, pixels.saturated / max(pixels.lit * count, 1.0))
        > _OVEREXPOSED,
        Flag.SMEARED: max(pixels.columns, pixels.lines) > _SMEARED,
    }
    return [flag for flag, there in found.items() if there]


def _scene_of_pixels(record: ImageRecord) -> Scene:
    """Return what is in a frame without a state or a shape."""
    pixels = record.pixels
    if pixels.lit < _FEWEST_LIT or pixels.likeness < _NOISE:
        return Scene.NO_BODY
    return Scene.FILLED if min(pixels.lit, pixels.edges) > _MOST_LIT else Scene.LIMB


def _scene(share: float) -> Scene:
    """Return what is in a frame by the share of it that meets the shape."""
    if share < _LEAST_BODY:
        return Scene.NO_BODY
    return Scene.FILLED if share == 1.0 else Scene.LIMB


def _fit(
    record: ImageRecord,
    image: SpcImage,
    caster: RayCaster,
    coarse: RenderedFrame,
    workspace: Workspace,
) -> Fit:
    """Compare an image with the rendered shape in all orientations."""
    path = workspace.exposure_path(record.name)
    if not path.is_file():
        raise WorkspaceError(
            "is not there, though the catalogue lists it", path, "import the image again"
        )
    dn = read_image_data(path, *record.size)
    square = record.size[0] == record.size[1]
    turns = [turn for turn in Turn if square or not turn.exchanges]
    low, reach = float(image.thresholds[0]), _REACH * max(record.size)

    def match(turn: Turn, rendered: RenderedFrame) -> FrameMatch:
        turned = np.ascontiguousarray(turn.orientation.apply(dn))
        return compare_frame(turned, rendered, lowest=low, reach_px=reach)

    found = {turn: match(turn, coarse) for turn in turns}
    best, second = sorted(turns, key=lambda turn: -found[turn].correlation)[:2]
    scores = [found[turn].correlation for turn in (best, second)]
    clear = scores[0] >= _FITS and scores[0] - scores[1] >= _CLEARLY
    fine = render_frame(caster, image, step=_step(record, _FINE))
    chosen = match(best if clear else Turn.AS_STORED, fine)
    return Fit(
        best if clear else None, scores[0], found[Turn.AS_STORED].given, scores[1],
        chosen.offset, chosen.overlap, chosen.overlap_given,
    )  # fmt: skip


def _fit_flags(record: ImageRecord, fit: Fit, share: float) -> list[Flag]:
    """Return what the comparison with the shape shows."""
    if fit.turn is None:
        # Without a limb a coarse shape need not look like the ground.
        outline = share < _MOST_OF_FRAME or fit.overlap_given < _ALIKE
        return [Flag.UNMATCHED] if outline and fit.given < _FITS else []
    if fit.turn is not Turn.AS_STORED:
        return [Flag.MIRRORED if fit.turn.mirrored else Flag.TURNED]
    far = np.hypot(*fit.offset_px) > _FAR * max(record.size)
    return [Flag.OFFSET] if far else []


def _step(record: ImageRecord, cells: int) -> int:
    """Return pixels along a side of a cell."""
    return max(1, -(-max(record.size) // cells))
