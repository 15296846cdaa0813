"""What an image shows, and whether it fits its state: triage of the images of a workspace."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fusion.pipeline.items import ItemStore, whole_version
from fusion.runtime import Executor, Progress
from fusion.runtime.remaining import Timed
from fusion.stages.images.catalogue import catalogue_path, read_catalogue
from fusion.stages.images.causes import (
    COARSE,
    MOST_OF_FRAME,
    CauseSearch,
    is_distinct,
    match_frame,
    near,
    pixels_of,
    reach_of,
    step_of,
)
from fusion.stages.images.importing import ITEM_PLACE
from fusion.stages.images.pixels import file_digest
from fusion.stages.images.record import ImageRecord
from fusion.stages.images.triage_report import (
    Fit,
    Flag,
    Likely,
    Scene,
    Triage,
    TriageReport,
)
from fusion.stages.images.turns import Turn
from fusion.workspace import Workspace
from spcola.arrays import FloatArray
from spcola.camera import SpcImage
from spcola.errors import WorkspaceError
from spcola.imagematching.frames import (
    FrameMatch,
    RenderedFrame,
    View,
    center_view,
    footprint,
    render_frame,
)
from spcola.imagematching.frames.mistakes import BodyOutline, ViewProblem
from spcola.navigation import et_from_utc
from spcola.shape import RayCaster

# To be raised with every change of what triage finds: kept results of another number are not used.
_TRIAGE = 3
# Cells along the longer side of a frame, to find the offset.
_FINE = 256
_FEWEST_LIT, _MOST_LIT = 5e-4, 0.995
_LEAST_BODY = 1e-3
_OVEREXPOSED, _SMEARED, _NOISE = 0.01, 0.05, 0.2
_FITS, _CLEARLY = 0.5, 0.05
_ALIKE = 0.7
# Offsets beyond this share of the frame are named.
_FAR = 0.03
_PROBLEMS = {
    ViewProblem.INSIDE: Flag.INSIDE,
    ViewProblem.AWAY: Flag.AWAY,
    ViewProblem.TINY: Flag.TINY,
    ViewProblem.NIGHT: Flag.NIGHT,
}
# What a wrong state may look like.
_OF_STATE = {Flag.UNMATCHED, Flag.TURNED, Flag.MIRRORED, Flag.OFFSET, *_PROBLEMS.values()}
_OF_FIT = (Flag.UNMATCHED, Flag.TURNED, Flag.MIRRORED, Flag.OFFSET)


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
    store = ItemStore(workspace.home / ITEM_PLACE.with_name("triage"), whole_version(_TRIAGE))
    begun = time.time()
    work = _Work(workspace, caster, digest, store)
    found = []
    with (progress or Progress()).items("triage", sizes, executor.workers) as task:
        named = [records[name] for name in sorted(records)]
        for one, spent in executor.stream(Timed(work.triage), named):
            found.append(one)
            task.advance_one(spent)
    store.remove_unused(begun)
    if caster is not None:
        found = _exchanged_states(workspace, caster, records, found, executor)
    return TriageReport(tuple(found))


def _exchanged_states(
    workspace: Workspace,
    caster: RayCaster,
    records: Mapping[str, ImageRecord],
    found: Sequence[Triage],
    executor: Executor,
) -> list[Triage]:
    """Return triage in which images that fit the state of another one are flagged.

    For each image that does not fit its state, the states of those next to it in time are tried,
    among all and among those that do not fit theirs.
    """
    stated = [one.name for one in found if workspace.image_path(one.name).is_file()]
    unexplained = {one.name for one in found if one.likely is None and _is_doubtful(one)}
    doubtful = unexplained & set(stated)
    if not doubtful:
        return list(found)
    images = {name: workspace.image(name) for name in stated}
    times = {name: et_from_utc(image.utc) for name, image in images.items()}
    among = [near(names, times) for names in (stated, doubtful)]
    search = CauseSearch(workspace, caster)

    def tried(one: Triage) -> Triage:
        if one.name not in doubtful:
            return one
        names = dict.fromkeys(name for some in among for name in some[one.name])
        others = {name: images[name] for name in names}
        given = 0.0 if one.fit is None else one.fit.correlation
        record = records[one.name]
        return _explained(
            one, search.other_image(record, images[one.name], given, others) if others else None
        )

    return list(executor.stream(tried, found))


def _is_doubtful(one: Triage) -> bool:
    """Return whether a picture of the body's outline does not clearly fit its state."""
    if Flag.EMPTY in one.flags or Flag.NO_STATE in one.flags or one.lit_share < _FEWEST_LIT:
        return False
    unclear = one.fit is not None and one.fit.turn is None and one.body_share < MOST_OF_FRAME
    return unclear or bool(_OF_STATE & set(one.flags))


def _explained(one: Triage, likely: Likely | None) -> Triage:
    """Return triage with its explanation, in place of flags of what the picture looks like."""
    if likely is None:
        return one
    kept = [flag for flag in one.flags if flag not in _OF_FIT]
    return replace(one, likely=likely, flags=(*kept, Flag.WRONG_STATE))


@dataclass(frozen=True, eq=False)
class _Work:
    """Triage of one image after another."""

    workspace: Workspace
    caster: RayCaster | None
    shape: str
    store: ItemStore

    def triage(self, record: ImageRecord) -> Triage:
        """Return what an image shows: the kept result, or a new one."""
        path, scan = (
            self.workspace.image_path(record.name), self.workspace.line_scan_path(record.name)
        )  # fmt: skip
        image: View | None = None
        camera, state = None, ""
        if path.is_file():
            image = self.workspace.image(record.name)
            # Bytes of a .SUM file that another program wrote need not name the exact camera.
            camera, state = image.camera, file_digest(path)
        elif scan.is_file():
            image, state = self.workspace.line_scan(record.name), file_digest(scan)

        def triage(*_inputs: Any) -> Triage:
            return _triage(record, image, self.caster, self.workspace)

        # Pixels that another program wrote are not those of the catalogue.
        exposed = self.workspace.exposure_path(record.name)
        pixels = file_digest(exposed) if exposed.is_file() else ""
        return self.store.result(triage, record, pixels, state, camera, self.shape)


def _triage(
    record: ImageRecord, image: View | None, caster: RayCaster | None, workspace: Workspace
) -> Triage:
    """Look at one image."""
    flags = _pixel_flags(record)
    scene, share, fit = _scene_of_pixels(record), np.nan, None
    if image is None:
        flags.append(Flag.NO_STATE)
        nan = np.nan
        return Triage(
            record.name, record.original, record.size, scene, share, record.pixels.lit,
            nan, nan, nan, nan, None, (), tuple(flags),
        )  # fmt: skip
    view = center_view(caster, image)
    corners: tuple[tuple[float, float], ...] = ()
    if caster is not None:
        rendered = render_frame(caster, image, step=step_of(record.size, COARSE))
        share = float(rendered.body.mean())
        corners = _longitudes_latitudes(footprint(caster, image))
        flags += _view_flags(record, image, caster, share)
        if Flag.EMPTY not in flags:
            scene = _scene(share)
        if share >= _LEAST_BODY and Flag.EMPTY not in flags:
            fit = _fit(record, image, caster, rendered, workspace)
            flags += _fit_flags(record, fit, share)
    phase, emission = np.degrees([view.phase, view.emission])
    found = Triage(
        record.name, record.original, record.size, scene, share, record.pixels.lit, view.range_m,
        view.resolution_m, float(phase), float(emission), fit, corners, tuple(flags),
    )  # fmt: skip
    if caster is None or not isinstance(image, SpcImage) or not _is_doubtful(found):
        return found
    given = 0.0 if fit is None else fit.correlation
    return _explained(found, CauseSearch(workspace, caster).mistake(record, image, given))


def _view_flags(record: ImageRecord, image: View, caster: RayCaster, share: float) -> list[Flag]:
    """Return what contradicts the shape at the state, and a body where the state has none."""
    if isinstance(image, SpcImage):
        problem = BodyOutline.of_mesh(caster.mesh).problem(image)
        if problem is not None:
            return [_PROBLEMS[problem]]
    shows = record.pixels.lit >= _FEWEST_LIT and record.pixels.likeness >= _NOISE
    return [Flag.AWAY] if share < _LEAST_BODY and shows else []


def _longitudes_latitudes(points: FloatArray) -> tuple[tuple[float, float], ...]:
    """Return east longitudes 0 … 360 and latitudes, degrees, of points (N, 3)."""
    longitude = np.degrees(np.arctan2(points[:, 1], points[:, 0])) % 360.0
    latitude = np.degrees(np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1])))
    return tuple((float(x), float(y)) for x, y in zip(longitude, latitude, strict=True))


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
    image: View,
    caster: RayCaster,
    coarse: RenderedFrame,
    workspace: Workspace,
) -> Fit:
    """Compare an image with the rendered shape in all orientations."""
    dn = pixels_of(workspace, record)
    square = record.size[0] == record.size[1]
    turns = [turn for turn in Turn if square or not turn.exchanges]

    def match(turn: Turn, rendered: RenderedFrame) -> FrameMatch:
        return match_frame(image, turn.orientation.apply(dn), rendered)

    found = {turn: match(turn, coarse) for turn in turns}
    best, second = sorted(turns, key=lambda turn: -found[turn].correlation)[:2]
    scores = [found[turn].correlation for turn in (best, second)]
    # The frame may lie far off its state; then another orientation is no finding, nor is a peak
    # at the border of the search.
    far = max(map(abs, found[best].offset))
    most = 0.5 * max(record.size) - coarse.step if best is Turn.AS_STORED else reach_of(record.size)
    clear = far <= most and scores[0] >= _FITS and scores[0] - scores[1] >= _CLEARLY
    clear = clear and is_distinct(best.orientation.apply(dn), coarse, found[best])
    fine = render_frame(caster, image, step=step_of(record.size, _FINE))
    chosen = match(best if clear else Turn.AS_STORED, fine)
    return Fit(
        best if clear else None, scores[0], found[Turn.AS_STORED].given, scores[1],
        chosen.offset, chosen.overlap, chosen.overlap_given,
    )  # fmt: skip


def _fit_flags(record: ImageRecord, fit: Fit, share: float) -> list[Flag]:
    """Return what the comparison with the shape shows."""
    if fit.turn is None:
        # Without a limb a coarse shape need not look like the ground.
        outline = share < MOST_OF_FRAME or fit.overlap_given < _ALIKE
        return [Flag.UNMATCHED] if outline and fit.given < _FITS else []
    if fit.turn is not Turn.AS_STORED:
        return [Flag.MIRRORED if fit.turn.mirrored else Flag.TURNED]
    far = np.hypot(*fit.offset_px) > _FAR * max(record.size)
    return [Flag.OFFSET] if far else []
