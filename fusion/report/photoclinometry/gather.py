"""What the report shows of the maplets solved from images."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fusion.report.photoclinometry.albedo import goodness_path
from fusion.report.photoclinometry.around import around_caster, around_files
from fusion.report.photoclinometry.comparing import image_strip
from fusion.report.photoclinometry.goodness import (
    chosen_maplets,
    read_goodness,
    worst_images,
)
from fusion.workspace import Workspace
from spcola.arrays import AnyArray
from spcola.formats.slope_directions import (
    SlopeDirections,
    read_slope_directions,
    slope_directions_path,
)
from spcola.grids import Maplet
from spcola.photometry.secondary_light import name_of_image
from spcola.shape import RayCaster

# Maplets with pictures, and images of each.
_MOST_MAPLETS, _MOST_IMAGES = 12, 9


@dataclass(frozen=True, eq=False)
class SolvedMaplet:
    """A maplet and its images.

    Parameters
    ----------
    maplet : Maplet
    why : str
        Why it is shown; empty where all are.
    strips : mapping of str to ndarray
        Image, rendering and residual by the name of the image, as of
        :func:`fusion.report.photoclinometry.image_strip`; the worst first.
    directions : SlopeDirections, optional
        Which slopes images determine; None where no file has it.
    """

    maplet: Maplet
    why: str
    strips: Mapping[str, AnyArray]
    directions: SlopeDirections | None = None


@dataclass(frozen=True, eq=False)
class SolvedMaplets:
    """Maplets solved from images.

    Parameters
    ----------
    content : mapping
        Of ``photoclinometry.json``.
    shown : tuple of SolvedMaplet
        Those with pictures.
    """

    content: Mapping[str, Any]
    shown: tuple[SolvedMaplet, ...]


def gather_solved(workspace: Workspace) -> SolvedMaplets | None:
    """Return what the report shows; None if no maplet of the solution was solved from images.

    Raises
    ------
    SpcolaError
        If a file cannot be read.
    """
    content = read_goodness(workspace)
    if content is None:
        return None
    beyond = RayCaster(workspace.shape()) if workspace.has_shape() else None
    shown = [
        _shown(workspace, content, name, why, beyond)
        for name, why in chosen_maplets(content, _MOST_MAPLETS).items()
        if workspace.maplet_path(name).is_file()
    ]
    return SolvedMaplets(content, tuple(shown))


def solved_inputs(workspace: Workspace) -> list[Path]:
    """Return the files that :func:`gather_solved` reads; they may be missing.

    Maplets of the solution are not among them, those of its parent are: around the shown ones.

    Raises
    ------
    SpcolaError
        If how images fit cannot be read.
    """
    content = read_goodness(workspace)
    if content is None:
        return []
    chosen = chosen_maplets(content, _MOST_MAPLETS)
    shown = [content["maplets"][name] for name in chosen]
    directions = [slope_directions_path(workspace.maplet_path(name)) for name in chosen]
    names = {
        name_of_image(image) or image for one in shown for image in worst_images(one)[:_MOST_IMAGES]
    }
    around = {path for one in shown for path in around_files(workspace, one)}
    shape = [workspace.shape_path()] if workspace.has_shape() else []
    images = [
        path
        for name in sorted(names)
        for path in (workspace.image_path(name), workspace.exposure_path(name))
    ]
    return [goodness_path(workspace), *shape, *sorted(around), *directions, *images]


def _shown(
    workspace: Workspace, content: Mapping[str, Any], name: str, why: str, beyond: RayCaster | None
) -> SolvedMaplet:
    maplet, one = workspace.maplet(name), content["maplets"][name]
    around = around_caster(workspace, one, maplet.grid.gsd)
    strips = {
        image: image_strip(workspace, content, maplet, image, beyond, around)
        for image in worst_images(one)[:_MOST_IMAGES]
    }
    path = slope_directions_path(workspace.maplet_path(name))
    found = read_slope_directions(path, maplet.grid.half_size) if path.is_file() else None
    return SolvedMaplet(maplet, why, strips, found)
