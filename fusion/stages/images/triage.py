"""What an image shows, and whether it fits its state: triage of the images of a workspace."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from fusion.pipeline.items import ItemStore
from fusion.runtime import Executor, Progress
from fusion.stages.images.catalogue import catalogue_path, read_catalogue
from fusion.stages.images.importing import ITEM_PLACE, ITEM_VERSION
from fusion.stages.images.pixels import file_digest
from fusion.stages.images.record import ImageRecord
from fusion.stages.images.triage_report import Fit, Flag, Scene, Triage, TriageReport
from fusion.stages.images.turns import Turn
from fusion.workspace import Workspace
from spcola.arrays import FloatArray
from spcola.errors import WorkspaceError
from spcola.formats.images import read_image_data
from spcola.imagematching.frames import (
    FrameMatch,
    RenderedFrame,
    View,
    center_view,
    compare_frame,
    footprint,
    render_frame,
)
from spcola.shape import RayCaster

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

        result = self.store.result(triage, record, state, camera, self.shape)
        return time.perf_counter() - begun, result


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
        rendered = render_frame(caster, image, step=_step(record, _COARSE))
        share = float(rendered.body.mean())
        corners = _longitudes_latitudes(footprint(caster, image))
        if Flag.EMPTY not in flags:
            scene = _scene(share)
        if share >= _LEAST_BODY and Flag.EMPTY not in flags:
            fit = _fit(record, image, caster, rendered, workspace)
            flags += _fit_flags(record, fit, share)
    phase, emission = np.degrees([view.phase, view.emission])
    return Triage(
        record.name, record.original, record.size, scene, share, record.pixels.lit, view.range_m,
        view.resolution_m, float(phase), float(emission), fit, corners, tuple(flags),
    )  # fmt: skip


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
