"""A shape's heights over a maplet grid."""

from __future__ import annotations

from typing import Literal

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import InvalidValueError
from spcola.grids import MapletGrid
from spcola.shape.rays import RayCaster


def shape_heights(
    caster: RayCaster,
    grid: MapletGrid,
    *,
    reach: float,
    surface: Literal["outermost", "nearest"] = "outermost",
) -> FloatArray:
    """Return the heights of a shape over the nodes of `grid`, along Uz.

    Parameters
    ----------
    caster : RayCaster
        Ray caster of the shape, body-fixed.
    grid : MapletGrid
        Grid of the heights.
    reach : float
        Search range above and below the reference plane, metres.
    surface : {"outermost", "nearest"}
        Where several sheets lie within reach: the highest, or the one closest to the plane.

    Returns
    -------
    (2q+1, 2q+1) ndarray
        Metres; NaN where nothing lies within reach, or where the first hit faces away from Uz
        (the ray began inside the body).

    Raises
    ------
    InvalidValueError
        If `reach` is not positive.
    """
    if not (np.isfinite(reach) and reach > 0):
        raise InvalidValueError(f"must be positive, not {reach} m", "reach")
    nodes = grid.points(np.zeros(grid.shape)).reshape(-1, 3)
    if surface == "outermost":
        height = _first_height(caster, nodes, grid.uz, reach, -reach)
    else:
        below = _first_height(caster, nodes, grid.uz, 0.0, -reach)
        above = _height_from_below(caster, nodes, grid.uz, reach)
        height = np.where(np.isnan(below) | (above < -below), above, below)
    return height.reshape(grid.shape)


def _first_height(
    caster: RayCaster, nodes: FloatArray, up: FloatArray, start: float, end: float
) -> FloatArray:
    """Return the height (N,) of the first hit of a ray down from `start`, no lower than `end`."""
    hits = caster.cast(nodes + start * up, np.broadcast_to(-up, nodes.shape))
    height = start - hits.distance
    return np.where((hits.normals @ up > 0) & (height >= end), height, np.nan)


def _height_from_below(
    caster: RayCaster, nodes: FloatArray, up: FloatArray, reach: float
) -> FloatArray:
    """Return the height (N,) of the first hit of a ray up from the plane, from its inside."""
    hits = caster.cast(nodes, np.broadcast_to(up, nodes.shape))
    return np.where((hits.normals @ up > 0) & (hits.distance <= reach), hits.distance, np.nan)
