"""The SPC solution of a synthetic mission: maplets, states and landmarks that agree."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from fusion.truth.planted import PlacedCenter
from fusion.truth.presets import MissionSettings
from fusion.truth.restoring import restored
from fusion.truth.work import Work, missing
from spcola.arrays import FloatArray
from spcola.camera import SpcImage
from spcola.formats.maplets import write_maplet
from spcola.formats.shapes import write_icq
from spcola.formats.solution import write_landmark, write_list, write_nominal, write_summary
from spcola.truth.campaign import Pass, plan_stations, stations_of_pass
from spcola.truth.campaign.states import SolvedState, make_state
from spcola.truth.sampled import LightMap, SampledSurface
from spcola.truth.solid import MeshSurface
from spcola.truth.solution import (
    landmarks_of,
    make_maplet,
    maplet_directions,
    measure_landmarks,
    spc_shape,
)

SHAPE_FILE = Path("SHAPEFILES") / "SHAPE.TXT"


Lit = Callable[[], LightMap]
"""Returns where the Sun shines; it is computed only if a missing file needs it."""


def write_shape(work: Work, light: Lit | None = None) -> None:
    """Write the solution's shape model; without `light`, that of a body without maplets."""
    path = work.site.spc / SHAPE_FILE
    if missing(path):
        shape = spc_shape(
            work.body,
            work.settings.to_spc,
            work.settings.shape_q,
            light=None if light is None else light(),
            settings=work.settings.solution,
        )
        write_icq(path, shape, digits=7)


def write_maplets(work: Work, light: Lit) -> list[PlacedCenter]:
    """Make and write the maplets with their sigma companions, without those entirely in the dark.

    Returns
    -------
    list of PlacedCenter
        Their frames in order; heights are in the files only.
    """
    directions = maplet_directions(work.body, work.settings.solution)
    names = [f"TR{number + 1:04d}" for number in range(len(directions))]
    notes = {name: work.site.note(name) for name in names}
    shines = light() if None in notes.values() else None

    def make(item: tuple[str, FloatArray]) -> PlacedCenter | None:
        name, direction = item
        noted = notes[name]
        if noted is None and shines is not None:
            noted = _write_maplet(work, name, direction, shines)
            work.site.keep(name, noted)
        return restored(PlacedCenter, noted, name) if noted else None

    found = work.done("maplets", make, zip(names, directions, strict=True), len(names))
    placed = [center for center in found if center is not None]
    write_list(work.site.spc / "MAPLIST.TXT", [center.name for center in placed], kind="landmark")
    return placed


def light_of(settings: MissionSettings, surface: SampledSurface | MeshSurface) -> LightMap:
    """Return where the Sun of a mission shines."""
    return LightMap.of(surface, sun_latitude=np.radians(settings.passes.sun_latitude_deg))


def _write_maplet(work: Work, name: str, direction: FloatArray, light: LightMap) -> dict[str, Any]:
    """Make and write one maplet; return its frame, or {} if it is entirely in the dark."""
    solved = make_maplet(
        work.body,
        work.settings.to_spc,
        name,
        direction=direction,
        light=light,
        settings=work.settings.solution,
        generator=work.random(f"maplet {name}"),
    )
    if not solved.maplet.valid.any():
        return {}
    path = work.site.spc / "MAPFILES" / f"{name}.MAP"
    write_maplet(path, solved.maplet, sigma_companion=True)
    grid = solved.maplet.grid
    center = PlacedCenter(
        name,
        tuple(grid.center.tolist()),
        tuple(tuple(axis) for axis in grid.axes.tolist()),
        grid.gsd,
        grid.half_size,
        tuple(solved.maplet.center_sigma.tolist()),
        tuple(solved.true_center.tolist()),
    )
    return asdict(center)


def plan_states(work: Work, passes: Sequence[Pass]) -> list[SolvedState]:
    """Return the states of all images: those of the passes, and those of the campaign."""
    settings = work.settings
    stations = [
        station
        for at in passes
        for station in stations_of_pass(
            at,
            settings.states.per_pass,
            radius=settings.body.radius,
            detector=settings.campaign.detector,
        )
    ]
    stations += plan_stations(settings.campaign, settings.passes)
    return [
        make_state(
            station,
            settings.to_spc,
            settings.passes.sun(station.time),
            settings=settings.states,
            generator=work.random(f"state {station.name}"),
            bits=settings.imaging.bits,
        )
        for station in stations
    ]


def write_states(
    work: Work,
    states: Sequence[SolvedState],
    centers: Sequence[PlacedCenter],
    shadows: SampledSurface,
) -> None:
    """Write .SUM, .NOM and .LMK files that agree with each other, and the lists."""
    folder = work.site.spc

    def make(state: SolvedState) -> SpcImage:
        seen = measure_landmarks(
            state,
            centers,
            shadows,
            settings=work.settings.states,
            generator=work.random(f"landmarks {state.solved.name}"),
        )
        image = replace(state.solved, landmarks=seen)
        if missing(path := folder / "SUMFILES" / f"{image.name}.SUM"):
            write_summary(path, image)
        if missing(path := folder / "NOMINALS" / f"{image.name}.NOM"):
            write_nominal(path, state.nominal)
        return image

    images = list(work.done("states", make, states, len(states)))
    for landmark in landmarks_of(centers, images, rms=work.settings.states.pixel_sigma):
        if missing(path := folder / "LMKFILES" / f"{landmark.name}.LMK"):
            write_landmark(path, landmark)
    write_list(folder / "PICTLIST.TXT", [image.name for image in images], kind="image")
    write_list(folder / "LMRKLIST.TXT", [center.name for center in centers], kind="landmark")
