"""Maplets solved on a coarse grid, in so few seconds that other assumptions can be compared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fusion.stages.lithos.sources import LithosSources
from spcola.camera import SpcImage
from spcola.grids import Maplet, project_maplet
from spcola.photometry.functions import PhotometricFunction
from spcola.photometry.photoclinometry import HeightConstraint, Photoclinometry

# Cells along a side of the grid, and most images: it shows what a whole solution would.
_CELLS, _IMAGES = 24, 12
# Points of the start that share one error.
_COMMON = 100.0


def coarse_images(sources: LithosSources, name: str) -> list[SpcImage]:
    """Return the images of a maplet with which it is solved on a coarse grid, evenly chosen.

    Parameters
    ----------
    sources : LithosSources
    name : str
        Of the maplet.
    """
    shown = sources.showing(name)
    return shown[:: -(-len(shown) // _IMAGES) or 1]


def coarse_solution(
    sources: LithosSources, name: str, function: PhotometricFunction
) -> Photoclinometry | None:
    """Return a maplet solved on a coarse grid; None if it has no heights to start from.

    Parameters
    ----------
    sources : LithosSources
    name : str
        Of the maplet.
    function : PhotometricFunction
    """
    start = _coarse(sources.start(name))
    if not start.valid.any():
        return None
    images = coarse_images(sources, name)
    digests = {image.name: sources.digests.of(image) for image in images}
    options = replace(
        sources.options.photoclinometry.for_images(digests), function=function, levels=(1,),
        other_functions=None,
    )  # fmt: skip
    around = HeightConstraint.of_sigma("start", start.height, start.grid.gsd, common=_COMMON)
    states = {image: sources.images.states[image] for image in digests}
    return sources.from_images(
        start, (), digests, sources.digests.shape, states, (around,), options
    )


def _coarse(start: Maplet) -> Maplet:
    """Return a start on the coarse grid, with albedo 1."""
    coarser = max((start.grid.size - 1) / _CELLS, 1.0)
    grid = start.grid.with_gsd(coarser * start.grid.gsd)
    height = project_maplet(start, grid).height
    return replace(
        start, grid=grid, height=height, albedo=np.ones(grid.shape),
        sigma=np.full(grid.shape, np.nan),
    )  # fmt: skip
