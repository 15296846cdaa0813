"""Mapolas as maplets of the solution: heights as they are, centres by images (Gaskell, §6.1)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fusion.registration.observations import ImagedMapolas, place_mapolas
from fusion.runtime import Executor, Progress
from fusion.runtime.remaining import Timed
from fusion.scene import Scene
from fusion.stages.albedo.sources import AlbedoSources
from fusion.workspace import Workspace
from spcola.arrays import FloatArray
from spcola.camera import ImagePoint
from spcola.grids import Maplet
from spcola.imagematching import Pictures, Sighting

# A place by images so many standard deviations from the registered one is wrong.
_IMPOSSIBLE = 5.0


@dataclass(frozen=True, eq=False)
class PlacedMapola:
    """A mapola where it enters the solution.

    Parameters
    ----------
    mapola : str
        Its name as a mapola.
    maplet : Maplet
        Heights of the mapola on a grid in the SPC frame, with the sigma of its centre; the name is
        the new one.
    moved : (3,) ndarray
        From where the registration has it, metres.
    pictures : tuple of ImagePoint
        Where images show V: measured, or predicted if the place is the registration's.
    measured : bool
    """

    mapola: str
    maplet: Maplet
    moved: FloatArray
    pictures: tuple[ImagePoint, ...]
    measured: bool


@dataclass(frozen=True, eq=False)
class _Seen:
    """Where images show a mapola: from the registered place (3,), covariance (3, 3), metres."""

    moved: FloatArray
    covariance: FloatArray
    pictures: tuple[ImagePoint, ...]


def placed_mapolas(
    workspace: Workspace,
    scene: Scene,
    sources: AlbedoSources,
    names: dict[str, str],
    executor: Executor,
    progress: Progress,
) -> list[PlacedMapola]:
    """Return mapolas where images show them, or where the registration has them.

    Parameters
    ----------
    workspace : Workspace
    scene : Scene
        Registered.
    sources : AlbedoSources
    names : dict of str to str
        New names by those of the mapolas.
    executor : Executor
    progress : Progress
    """
    grounds = {name: _registered(workspace, scene, name) for name in names}
    imaged = None
    if sources.work.centers == "images":
        grids = [ground.grid for ground in grounds.values()]
        sizes = [1.0 + len(sources.images.showing(grid)) for grid in grids]
        sightings = list[Sighting]()
        with progress.items("find mapolas in images", sizes, executor.workers) as task:
            find = Timed(sources.images.sighting)
            for sighting, spent in executor.stream(find, grounds.values()):
                sightings.append(sighting)
                task.advance_one(spent)
        imaged = place_mapolas(grids, sightings)
    pictures = Pictures(workspace.images(), sources.images.beyond, sources.images.choice)
    placed = []
    for row, (name, ground) in enumerate(grounds.items()):
        there = ground.with_layers(name=names[name])
        seen = None if imaged is None else _by_images(imaged, row)
        prior = scene.placements[name].covariance
        placed.append(_placed(name, there, prior, seen, pictures))
    return placed


def _registered(workspace: Workspace, scene: Scene, name: str) -> Maplet:
    """Return a mapola as a maplet where the registration has it."""
    mapola = workspace.mapola(name)
    sigma = np.sqrt(np.diag(scene.placements[name].covariance))
    grid = scene.mapola_grids[name]
    return Maplet(name, grid, mapola.height, sigma=mapola.sigma, center_sigma=sigma)


def _by_images(imaged: ImagedMapolas, row: int) -> _Seen | None:
    """Return where images show a mapola; None if they do not."""
    match = imaged.matches[row]
    if not match.usable:
        return None
    shared = np.concatenate([imaged.effects[row], imaged.common[row]], axis=1)
    covariance = match.covariance + shared @ shared.T
    return _Seen(match.displacement, covariance, _points(imaged.sightings[row]))


def _placed(
    mapola: str, ground: Maplet, prior: FloatArray, seen: _Seen | None, pictures: Pictures
) -> PlacedMapola:
    """Return a mapola at the mean of the registered place and that by images, by covariances.

    Images that all look from one side hardly determine the distance; the registration does. A place
    by images that is impossible with it is not used.
    """
    if seen is not None:
        both = prior + seen.covariance
        gain = np.linalg.solve(both, prior).T
        apart = float(seen.moved @ np.linalg.solve(both, seen.moved)) / 3.0
        if apart < _IMPOSSIBLE**2:
            moved = gain @ seen.moved
            grid = replace(ground.grid, center=ground.grid.center + moved)
            sigma = np.sqrt(np.diag(prior - gain @ prior))
            maplet = replace(ground, grid=grid, center_sigma=sigma)
            return PlacedMapola(mapola, maplet, moved, seen.pictures, True)
    return PlacedMapola(mapola, ground, np.zeros(3), pictures.of(ground.grid), False)


def _points(sighting: Sighting) -> tuple[ImagePoint, ...]:
    """Return where V was measured, with two decimals, by the names of the images."""
    measured = zip(sighting.images, np.round(sighting.observed, 2).tolist(), strict=True)
    found = [ImagePoint(image.name, *place) for image, place in measured]
    return tuple(sorted(found, key=lambda one: one.name))
