"""Images into a workspace: pixels, states, and the catalogue."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import spcola
from fusion.pipeline.items import ItemStore
from fusion.runtime import Executor, Progress
from fusion.runtime.folders import LOCK_FILE, clear_leftovers, locked, make_folder
from fusion.runtime.remaining import Timed
from fusion.stages.images.candidates import images_among
from fusion.stages.images.catalogue import CATALOGUE, read_catalogue, write_catalogue
from fusion.stages.images.choice import StateChoice, StateKind
from fusion.stages.images.doubts import StateDoubt, find_doubts
from fusion.stages.images.opened import OpenedImage, open_images
from fusion.stages.images.pixels import PixelWork, Recipe, write_pixels
from fusion.stages.images.planning import (
    ImportOptions,
    Planned,
    known_images,
    plan_images,
    turned_size,
)
from fusion.stages.images.record import ImageRecord, PixelFacts
from fusion.stages.images.sources import find_sightings
from fusion.stages.states import write_states
from fusion.workspace import Workspace
from spcola.camera.detector import Preparation
from spcola.camera.linescan import LineScanImage
from spcola.formats.solution.exact_camera import stored_camera

__all__ = ["Imported", "import_images"]
_LOCK = ".images.lock"
ITEM_PLACE = Path(".items") / "images"
ITEM_VERSION = f"{spcola.__version__} images 3"


@dataclass(frozen=True, eq=False)
class Imported:
    """What an import did.

    Parameters
    ----------
    new : tuple of ImageRecord
    known : tuple of ImageRecord
        Images that were there already, by content.
    filtered : int
        Images of other filters.
    remarks : tuple of str
        What does not fit together, one line each.
    doubts : tuple of StateDoubt
        New states that contradict the shape.
    """

    new: tuple[ImageRecord, ...]
    known: tuple[ImageRecord, ...]
    filtered: int
    remarks: tuple[str, ...]
    doubts: tuple[StateDoubt, ...] = ()


def import_images(
    workspace: Workspace,
    paths: Sequence[Path],
    options: ImportOptions,
    *,
    executor: Executor,
    progress: Progress | None = None,
    wait: bool = False,
    lasting: Callable[[str], str] = str,
) -> Imported:
    """Bring images into a workspace.

    Labels, names, states and cameras of all images are checked first. Then the pixels are written
    image by image; an interrupted import goes on with those that are missing. States, list and
    catalogue are written at the end. No file of an image that is there is replaced: what other
    solutions rest on does not change.

    Parameters
    ----------
    workspace : Workspace
        States go into its solution; pixels belong to all solutions.
    paths : sequence of Path
        Images; labels, pixels of labels, and ISD files may be given with them.
    options : ImportOptions
    executor : Executor
    progress : Progress, optional
    wait : bool
        Whether to wait for another program that brings in images, or works with the solution into
        which states go.
    lasting : callable
        Returns the path by which the catalogue names a file that is read, from the one where it is
        read: that may be a passing one.

    Raises
    ------
    SpcolaError
        What does not fit, in one line; nothing was written for images that it concerns.
    """
    progress = progress or Progress()
    with _writing(workspace, options.states, wait=wait):
        _clear(workspace)
        catalogue = read_catalogue(workspace)
        given = images_among(paths, options.states)
        opened = open_images(given, executor, size=options.size)
        images = [image for image in opened if _is_wanted(image, options.filters)]
        found = find_sightings(workspace, images, options.states)
        known = known_images(workspace, images, catalogue, options)
        planned = plan_images(workspace, images, found.sightings, known, catalogue, options)
        stated = {one.name: one.sighting for one in planned if one.sighting is not None}
        doubts = find_doubts(workspace, stated)
        fresh = [one for one in planned if one.image.digest not in known]
        facts = _all_pixels(workspace, fresh, options, executor, progress)
        records = [
            _record(workspace, one, facts.get(one.name), options, known.get(one.image.digest))
            for one in planned
        ]
        records = [_lasting(record, lasting) for record in records]
        _write_states(workspace, planned, records, options.recipe)
        if planned:
            merged = {**catalogue, **{record.name: record for record in records}}
            write_catalogue(workspace, merged.values())
    new = [record for record in records if record.name not in catalogue]
    old = [record for digest, record in known.items()]
    filtered = len(opened) - len(images)
    return Imported(tuple(new), tuple(old), filtered, found.remarks, doubts)


@contextmanager
def _writing(workspace: Workspace, states: StateChoice, *, wait: bool) -> Iterator[None]:
    """Lock images and catalogue, and with states their solution: a stage would read half of them.

    Locked at the beginning: nobody wants to be refused after an hour of work on pixels.
    """
    with locked(workspace.root / _LOCK, wait=wait):
        if states.kind is StateKind.NONE:
            yield
            return
        with locked(workspace.home / LOCK_FILE, wait=wait):
            yield


def _clear(workspace: Workspace) -> None:
    """Remove what a killed import left; the lock of imports covers nothing else."""
    clear_leftovers([workspace.root / "IMAGEFILES", workspace.root / ITEM_PLACE])
    for left in workspace.root.glob(f".{CATALOGUE}.*.part"):
        left.unlink(missing_ok=True)


def _is_wanted(image: OpenedImage, filters: tuple[str, ...]) -> bool:
    return not filters or (image.filter or "") in filters


def _all_pixels(
    workspace: Workspace,
    planned: Sequence[Planned],
    options: ImportOptions,
    executor: Executor,
    progress: Progress,
) -> dict[str, PixelFacts]:
    """Write the pixels of all images; each finished one is kept as an item."""
    if not planned:
        return {}
    make_folder(workspace.root / "IMAGEFILES")
    store = ItemStore(workspace.root / ITEM_PLACE, ITEM_VERSION)
    begun = time.time()
    bring = _Bringing(options.recipe.preparation(), options, store, workspace)
    facts = {}
    sizes = [float(one.image.size[0] * one.image.size[1]) for one in planned]
    with progress.items("images", sizes, executor.workers) as task:
        done = executor.stream(Timed(bring.image), planned)
        for one, (found, spent) in zip(planned, done, strict=True):
            facts[one.name] = found
            task.advance_one(spent)
    store.remove_unused(begun)
    return facts


@dataclass(frozen=True, eq=False)
class _Bringing:
    """Work on the pixels of one image after another."""

    preparation: Preparation
    options: ImportOptions
    store: ItemStore
    workspace: Workspace

    def image(self, one: Planned) -> PixelFacts:
        """Return the facts of an image whose .DAT file is there."""
        target = self.workspace.exposure_path(one.name)
        work = PixelWork(one.image.path, self.options.size, target)

        def written(*_made_from: object) -> PixelFacts:
            return write_pixels(work, self.preparation, self.options.recipe)

        # Of a detached label and of a .DAT file the digest of the pixels does not have the layout.
        layout = (one.image.size, one.image.label)
        recipe = self.options.recipe.digest
        facts = self.store.result(written, one.image.digest, layout, recipe, target)
        # The item outlives a file that was removed.
        return facts if target.is_file() else written()


def _record(
    workspace: Workspace,
    one: Planned,
    facts: PixelFacts | None,
    options: ImportOptions,
    known: ImageRecord | None,
) -> ImageRecord:
    """Return the line of the catalogue of an image."""
    image, sighting = one.image, one.sighting
    state: dict[str, Any] | None = None
    camera = fit = None
    notes = image.notes
    if sighting is not None:
        source = str(sighting.state.source)
        state = {"source": source, "from": sighting.origin, "solution": workspace.solution}
        camera, notes = sighting.camera_origin, (*notes, *sighting.notes)
        if sighting.scan is not None:
            state["lines"] = sighting.scan.height
        elif (stored := stored_camera(sighting.camera)).difference.largest_px > 0.0:
            fit = stored.as_json()
    elif (path := _state_path(workspace, one.name)).is_file():
        state = {"source": "sum", "from": str(path), "solution": workspace.solution}
        camera = str(path)
    if known is not None:
        return replace(known, state=state, camera=camera, notes=notes, camera_fit=fit)
    assert facts is not None
    return ImageRecord(
        one.name, image.original, str(image.path.absolute()), image.digest, options.recipe.digest,
        str(options.recipe.turn), turned_size(image, options), facts, image.label, state, camera,
        notes, fit,
    )  # fmt: skip


def _lasting(record: ImageRecord, lasting: Callable[[str], str]) -> ImageRecord:
    """Return a record that names image, state and camera where they remain."""
    state, camera = record.state, record.camera
    if state is not None:
        state = {**state, "from": lasting(state["from"])}
    if camera is not None:
        camera = lasting(camera)
    return replace(record, source=lasting(record.source), state=state, camera=camera)


def _write_states(
    workspace: Workspace,
    planned: Sequence[Planned],
    records: Sequence[ImageRecord],
    recipe: Recipe,
) -> None:
    """Write .SUM and .NOM files of the images with a state, and files of line scans."""
    images, nominal, scans = [], [], []
    for one, record in zip(planned, records, strict=True):
        if one.sighting is None:
            continue
        state = replace(one.sighting.state, name=one.name)
        thresholds = record.pixels.thresholds
        # Those of the camera's .SUM file are used unless the user chose others.
        if one.sighting.thresholds and not recipe.chooses_thresholds:
            thresholds = one.sighting.thresholds
        if one.sighting.scan is not None:
            scans.append(LineScanImage(one.name, one.sighting.scan, state.sun, thresholds))
            continue
        images.append(state.as_image(one.sighting.camera, thresholds=thresholds))
        if one.sighting.rate is not None:
            nominal.append(state.as_nominal(one.sighting.rate))
    if images or scans:
        write_states(workspace, images, nominal, scans)


def _state_path(workspace: Workspace, name: str) -> Path:
    """Return where the state of an image lies, or would lie."""
    scan = workspace.line_scan_path(name)
    return scan if scan.is_file() else workspace.image_path(name)
