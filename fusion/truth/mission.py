"""The synthetic mission: an SPC working folder and lidar files of a body that is known."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np

from fusion.progress import Progress
from fusion.truth.planted import TRUTH_FILE, MissionSettings, Planted, write_truth
from fusion.workspace import SPC_FOLDERS
from lidar.formats.ola import write_ola
from lidar.truth import ScanErrors, draw_errors, make_scan, scan_name
from spcola.atomic import write_error, write_text
from spcola.errors import WorkspaceError
from spcola.formats.icq import write_icq
from spcola.formats.lists import write_list
from spcola.formats.lmk import write_landmark
from spcola.formats.map import write_maplet
from spcola.formats.nom import write_nominal
from spcola.formats.sum import write_summary
from spcola.image import SpcImage
from spcola.maplet import Maplet
from spcola.nominal import NominalState
from spcola.truth.body import TruthBody
from spcola.truth.passes import Pass, plan_passes
from spcola.truth.solution import lattice, make_maplet, spc_shape
from spcola.truth.states import landmark_of, make_states, measure_landmarks
from spcola.truth.streams import stream

SPC_FOLDER, LIDAR_FOLDER = "spc", "lidar"
_MAKING = ".making"
# Writing one file waits for the disk while the next is computed.
_WRITERS = 2


def make_mission(
    folder: str | Path,
    *,
    settings: MissionSettings | None = None,
    progress: Progress | None = None,
) -> Planted:
    """Write a synthetic mission into `folder` and return what was planted.

    ``spc/`` is an SPC working folder in the solution's frame, ``lidar/`` holds one OLA level-2
    file for each scan in the reference frame (the body's own), ``truth.json`` what is planted,
    written last: with it, the mission is complete.

    Parameters
    ----------
    folder : path
        Made if missing. A mission that is there is replaced.
    settings : MissionSettings, optional
        The demo's by default.
    progress : Progress, optional

    Raises
    ------
    WorkspaceError
        If something cannot be written, or `folder` holds other things than a mission.
    """
    root = Path(folder)
    settings = settings or MissionSettings.demo()
    progress = progress or Progress()
    _clear(root)
    body = TruthBody(settings.body)
    passes = plan_passes(settings.passes, stream(settings.seed, "passes"))
    days = _day_biases(passes, settings)
    with progress.task("lidar scans", len(passes)) as task:
        scans = {}
        for at in passes:
            scans[scan_name(at)] = _write_scan(root, body, at, settings, days[at.day])
            task.advance()
    maplets = _write_maplets(root / SPC_FOLDER, body, settings, progress)
    _write_states(root / SPC_FOLDER, passes, maplets, settings)
    shape = spc_shape(body, settings.to_spc, settings.shape_q)
    write_icq(root / SPC_FOLDER / "SHAPEFILES" / "SHAPE.TXT", shape, digits=7)
    planted = Planted(settings, scans, days)
    write_truth(root / TRUTH_FILE, planted)
    (root / _MAKING).unlink()
    return planted


def _clear(root: Path) -> None:
    """Make the folders of a mission anew; leave a folder of other things alone."""
    parts = (SPC_FOLDER, LIDAR_FOLDER)
    known = {*parts, TRUTH_FILE, _MAKING}
    try:
        root.mkdir(parents=True, exist_ok=True)
        there = {entry.name for entry in root.iterdir()}
        # Folders of these names may be somebody's data: only those of a mission made here go.
        if there - known or (there and not there & {TRUTH_FILE, _MAKING}):
            raise WorkspaceError(
                "holds other things than a synthetic mission", root, "choose an empty folder"
            )
        write_text(root / _MAKING, "an unfinished synthetic mission\n")
        (root / TRUTH_FILE).unlink(missing_ok=True)
        for part in parts:
            if (root / part).exists():
                shutil.rmtree(root / part)
        for name in SPC_FOLDERS:
            (root / SPC_FOLDER / name).mkdir(parents=True)
        (root / LIDAR_FOLDER).mkdir()
    except OSError as error:
        raise write_error(root, error) from error


def _day_biases(passes: Sequence[Pass], settings: MissionSettings) -> dict[str, float]:
    """Return the relative bias of the ranges of each day that has a pass."""
    days = sorted({at.day for at in passes})
    biases = settings.day_scale_bias or (0.0,)
    return {day: biases[number % len(biases)] for number, day in enumerate(days)}


def _write_scan(
    root: Path, body: TruthBody, at: Pass, settings: MissionSettings, bias: float
) -> ScanErrors:
    """Make and write the scan of a pass; each has random streams of its own."""
    name = scan_name(at)
    errors = draw_errors(settings.lidar, stream(settings.seed, f"errors {name}"), range_scale=bias)
    generator = stream(settings.seed, f"shots {name}")
    scan = make_scan(body, at, settings=settings.lidar, errors=errors, generator=generator)
    write_ola(root / LIDAR_FOLDER / f"{name}.dat", [scan])
    return errors


def _write_maplets(
    folder: Path, body: TruthBody, settings: MissionSettings, progress: Progress
) -> list[Maplet]:
    """Make and write the maplets, with their sigma companions; leave out what is all dark."""
    directions = lattice(settings.solution.maplets)
    maplets = []
    with progress.task("maplets", len(directions)) as task, ThreadPoolExecutor(_WRITERS) as pool:
        writing = []
        for number, direction in enumerate(directions):
            name = f"TR{number + 1:04d}"
            maplet = make_maplet(
                body,
                settings.to_spc,
                name,
                direction=direction,
                settings=settings.solution,
                generator=stream(settings.seed, f"maplet {name}"),
            )
            if maplet.valid.any():
                maplets.append(maplet)
                path = folder / "MAPFILES" / f"{name}.MAP"
                writing.append(pool.submit(write_maplet, path, maplet, sigma_companion=True))
            task.advance()
        for written in writing:
            written.result()
    write_list(folder / "MAPLIST.TXT", [m.name for m in maplets], kind="landmark")
    return maplets


def _write_states(
    folder: Path, passes: Sequence[Pass], maplets: Sequence[Maplet], settings: MissionSettings
) -> None:
    """Write .SUM, .NOM and .LMK files that agree with each other, and the lists."""
    images: list[SpcImage] = []
    for at in passes:
        generator = stream(settings.seed, f"states {at.number}")
        for image, nominal in _states_of(at, settings, generator):
            seen = measure_landmarks(image, maplets, settings.states.pixel_sigma, generator)
            images.append(replace(image, landmarks=seen))
            write_summary(folder / "SUMFILES" / f"{image.name}.SUM", images[-1])
            write_nominal(folder / "NOMINALS" / f"{image.name}.NOM", nominal)
    for maplet in maplets:
        landmark = landmark_of(maplet, maplets, images, settings.states.pixel_sigma)
        write_landmark(folder / "LMKFILES" / f"{maplet.name}.LMK", landmark)
    write_list(folder / "PICTLIST.TXT", [image.name for image in images], kind="image")
    write_list(folder / "LMRKLIST.TXT", [m.name for m in maplets], kind="landmark")


def _states_of(
    at: Pass, settings: MissionSettings, generator: np.random.Generator
) -> list[tuple[SpcImage, NominalState]]:
    return make_states(
        at, settings.passes, settings.to_spc, settings=settings.states, generator=generator
    )
