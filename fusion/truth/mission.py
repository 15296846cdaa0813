"""The synthetic mission: an SPC working folder and lidar files of a body that is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fusion.executor import Executor, ThreadExecutor
from fusion.progress import Progress
from fusion.truth.generation import Site, building, files_of, finished
from fusion.truth.planted import TRUTH_FILE, Planted, write_truth
from fusion.truth.presets import LIDAR_FORMATS, MissionSettings
from fusion.truth.size import check_room, mission_size
from lidar.formats.ola import write_ola
from lidar.truth import ScanErrors, draw_errors, make_scan, scan_name
from spcola.formats.icq import write_icq
from spcola.formats.lists import write_list
from spcola.formats.lmk import write_landmark
from spcola.formats.map import write_maplet
from spcola.formats.nom import write_nominal
from spcola.formats.sum import write_summary
from spcola.image import SpcImage
from spcola.maplet import Maplet, MapletGrid
from spcola.truth.body import TruthBody
from spcola.truth.light import LightMap
from spcola.truth.passes import Pass, plan_passes
from spcola.truth.sampled import SampledSurface
from spcola.truth.solution import make_maplet, maplet_directions, spc_shape
from spcola.truth.states import landmark_of, make_states, measure_landmarks
from spcola.truth.streams import stream

_SHAPE = Path("SHAPEFILES") / "SHAPE.TXT"
# What casts shadows on the light map is resolved to this, metres.
_LIGHT_SPACING = 1.0


@dataclass(frozen=True)
class _Work:
    """What every part of the generation works with."""

    settings: MissionSettings
    site: Site
    body: TruthBody
    executor: Executor
    progress: Progress

    def stream(self, purpose: str) -> np.random.Generator:
        """Return the random numbers of one item: no other item draws from them."""
        return stream(self.settings.seed, purpose)


def make_mission(
    folder: str | Path,
    *,
    settings: MissionSettings | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    replace: bool = False,
) -> Planted:
    """Write a synthetic mission into `folder` and return what was planted.

    ``spc/`` is an SPC working folder in the solution's frame, ``lidar/`` holds one file for each
    scan in the reference frame (the body's own), ``truth.json`` what is planted, written last:
    with it, the mission is complete. What is there of the same mission is kept; the bytes depend
    neither on that nor on the number of workers.

    Parameters
    ----------
    folder : path
        Made if missing.
    settings : MissionSettings, optional
        The preset mini by default.
    executor, progress : optional
        Where work is done, by default on one thread for each core, and where it is told.
    replace : bool
        Whether another mission that is there may be removed.

    Raises
    ------
    WorkspaceError
        If something cannot be written, or the disk lacks room; if `folder` holds other things
        than a mission, or another one.
    """
    root = Path(folder)
    settings = settings or MissionSettings.mini()
    if (there := finished(root, settings)) is not None:
        return there
    check_room(root, mission_size(settings))
    with building(root, settings, replace=replace) as site:
        body = TruthBody(settings.body)
        work = _Work(settings, site, body, executor or ThreadExecutor(), progress or Progress())
        passes = plan_passes(settings.passes, work.stream("passes"))
        days = _day_biases(passes, settings)
        _write_shape(work)
        scans = _write_scans(work, passes, days)
        if settings.spc:
            _write_states(work, passes, _write_maplets(work))
        planted = Planted(settings, scans, days, files_of(root))
        write_truth(root / TRUTH_FILE, planted)
    return planted


def _day_biases(passes: Sequence[Pass], settings: MissionSettings) -> dict[str, float]:
    """Return the relative bias of the ranges of each day that has a pass."""
    days = sorted({at.day for at in passes})
    biases = settings.day_scale_bias or (0.0,)
    return {day: biases[number % len(biases)] for number, day in enumerate(days)}


def _write_shape(work: _Work) -> None:
    path = work.site.spc / _SHAPE
    if not path.exists():
        shape = spc_shape(work.body, work.settings.to_spc, work.settings.shape_q)
        write_icq(path, shape, digits=7)


def _write_scans(
    work: _Work, passes: Sequence[Pass], days: dict[str, float]
) -> dict[str, ScanErrors]:
    """Make and write the scans of the passes; return their errors by their names."""
    settings = work.settings.lidar

    def make(at: Pass) -> ScanErrors:
        name = scan_name(at)
        errors = draw_errors(settings, work.stream(f"errors {name}"), range_scale=days[at.day])
        path = work.site.lidar / f"{name}{LIDAR_FORMATS[work.settings.lidar_format]}"
        if not path.exists():
            generator = work.stream(f"shots {name}")
            scan = make_scan(work.body, at, settings=settings, errors=errors, generator=generator)
            write_ola(path, [scan])
        return errors

    scans = {}
    with work.progress.task("lidar scans", len(passes)) as task:
        for at, errors in zip(passes, work.executor.stream(make, passes), strict=True):
            scans[scan_name(at)] = errors
            task.advance()
    return scans


def _write_maplets(work: _Work) -> list[Maplet]:
    """Make and write the maplets, with their sigma companions; leave out what is all dark.

    Returns
    -------
    list of Maplet
        Without heights: where they are, and how well that is known.
    """
    directions = maplet_directions(work.body, work.settings.solution)
    latitude = np.radians(work.settings.passes.sun_latitude_deg)
    light = LightMap.of(SampledSurface(work.body, _LIGHT_SPACING), sun_latitude=latitude)
    names = [f"TR{number + 1:04d}" for number in range(len(directions))]

    def make(item: tuple[str, Any]) -> dict[str, Any]:
        name, direction = item
        noted = work.site.note(name)
        if noted is None:
            noted = _write_maplet(work, name, direction, light)
            work.site.keep(name, noted)
        content: dict[str, Any] = noted
        return content

    maplets = []
    with work.progress.task("maplets", len(directions)) as task:
        for noted in work.executor.stream(make, zip(names, directions, strict=True)):
            if noted:
                maplets.append(_placed(noted))
            task.advance()
    write_list(work.site.spc / "MAPLIST.TXT", [m.name for m in maplets], kind="landmark")
    return maplets


def _write_maplet(work: _Work, name: str, direction: Any, light: LightMap) -> dict[str, Any]:
    """Make and write one maplet; return what the landmarks need of it, nothing if it is dark."""
    solved = make_maplet(
        work.body,
        work.settings.to_spc,
        name,
        direction=direction,
        light=light,
        settings=work.settings.solution,
        generator=work.stream(f"maplet {name}"),
    )
    maplet = solved.maplet
    if not maplet.valid.any():
        return {}
    write_maplet(work.site.spc / "MAPFILES" / f"{name}.MAP", maplet, sigma_companion=True)
    grid = maplet.grid
    return {
        "name": name,
        "center": grid.center.tolist(),
        "axes": grid.axes.tolist(),
        "gsd": grid.gsd,
        "half_size": grid.half_size,
        "center_sigma": maplet.center_sigma.tolist(),
    }


def _placed(noted: dict[str, Any]) -> Maplet:
    """Return a maplet without heights from its note."""
    grid = MapletGrid(*(noted[key] for key in ("center", "axes", "gsd", "half_size")))
    unknown = np.full(grid.shape, np.nan)
    return Maplet(noted["name"], grid, unknown, center_sigma=np.array(noted["center_sigma"]))


def _write_states(work: _Work, passes: Sequence[Pass], maplets: Sequence[Maplet]) -> None:
    """Write .SUM, .NOM and .LMK files that agree with each other, and the lists."""
    folder, settings = work.site.spc, work.settings
    images: list[SpcImage] = []
    for at in passes:
        generator = work.stream(f"states {at.number}")
        states = make_states(
            at, settings.passes, settings.to_spc, settings=settings.states, generator=generator
        )
        for image, nominal in states:
            seen = measure_landmarks(image, maplets, settings.states.pixel_sigma, generator)
            images.append(replace(image, landmarks=seen))
            if not (path := folder / "SUMFILES" / f"{image.name}.SUM").exists():
                write_summary(path, images[-1])
            if not (path := folder / "NOMINALS" / f"{image.name}.NOM").exists():
                write_nominal(path, nominal)
    for maplet in maplets:
        if not (path := folder / "LMKFILES" / f"{maplet.name}.LMK").exists():
            rms = settings.states.pixel_sigma
            write_landmark(path, landmark_of(maplet, maplets, images, rms))
    write_list(folder / "PICTLIST.TXT", [image.name for image in images], kind="image")
    write_list(folder / "LMRKLIST.TXT", [m.name for m in maplets], kind="landmark")
