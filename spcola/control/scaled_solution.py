"""An SPC solution with all its lengths multiplied by one factor: its images fit as before."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

from spcola.camera import SpcImage
from spcola.control.landmark import Landmark
from spcola.grids import Maplet, MapletGrid
from spcola.navigation import NominalState
from spcola.shape import Mesh
from spcola.shape.icq import IcqShape

Shape = TypeVar("Shape", Mesh, IcqShape)


def scaled_grid(grid: MapletGrid, factor: float) -> MapletGrid:
    """Return the grid with its centre and GSD multiplied by `factor`."""
    return replace(grid, center=factor * grid.center, gsd=factor * grid.gsd)


def scaled_maplet(maplet: Maplet, factor: float) -> Maplet:
    """Return the maplet, with heights and sigmas, multiplied by `factor`; albedo is unchanged."""
    return replace(
        maplet,
        grid=scaled_grid(maplet.grid, factor),
        height=factor * maplet.height,
        sigma=factor * maplet.sigma,
        center_sigma=factor * maplet.center_sigma,
    )


def scaled_landmark(landmark: Landmark, factor: float) -> Landmark:
    """Return the landmark multiplied by `factor`; its overlaps, in grid steps, are unchanged."""
    return replace(
        landmark,
        grid=scaled_grid(landmark.grid, factor),
        sigma=factor * landmark.sigma,
        prior_sigma=factor * landmark.prior_sigma,
    )


def scaled_image(image: SpcImage, factor: float) -> SpcImage:
    """Return the image taken from `factor` times as far; camera, axes and pixels are unchanged."""
    return replace(image, scobj=factor * image.scobj, scobj_sigma=factor * image.scobj_sigma)


def scaled_nominal(state: NominalState, factor: float) -> NominalState:
    """Return the nominal state with its distance to the solved one multiplied by `factor`."""
    return replace(
        state,
        velocity=factor * state.velocity,
        scobj=factor * state.scobj,
        scobj_sigma=factor * state.scobj_sigma,
    )


def scaled_shape(shape: Shape, factor: float) -> Shape:
    """Return the shape with its vertices multiplied by `factor`; a layer is unchanged."""
    return replace(shape, vertices=factor * shape.vertices)
