"""A covering of a body with maplet grids, made from its shape."""

from __future__ import annotations

from spcola.errors import InvalidValueError
from spcola.grids import MapletGrid
from spcola.shape.mesh import Mesh
from spcola.shape.rays import RayCaster
from spcola.shape.samples import sample_surface
from spcola.shape.uncovered import Uncovered

SAMPLES_PER_HALF = 10
"""Surface samples along half a side of a grid; finer costs time and saves few grids."""


def covering(
    shape: RayCaster | Mesh, gsd: float, half_size: int, *, overlap: float = 0.2
) -> list[MapletGrid]:
    """Return grids such that every surface point of a shape lies in at least one.

    A point lies in a grid if it projects into its square, no further from the plane than half a
    side, on a facet that faces Uz (at 78° or less). Each next grid is centred on the uncovered
    point that is furthest from all centres, facing the mean normal around it: centres are evenly
    spaced without any assumption about the shape.

    Parameters
    ----------
    shape : RayCaster or Mesh
        Body-fixed.
    gsd : float
        GSD of the grids, metres.
    half_size : int
        q of the grids.
    overlap : float
        Share of the half-side, 0 … 0.8: every surface point lies at least this far inside the
        rim of some grid.

    Raises
    ------
    InvalidValueError
        If a setting is out of range or the shape has no area.
    """
    mesh = shape.mesh if isinstance(shape, RayCaster) else shape
    if not 0 <= overlap <= 0.8:
        raise InvalidValueError(f"must lie between 0 and 0.8, not {overlap}", "overlap")
    half = gsd * half_size
    step = half * (1 - overlap) / SAMPLES_PER_HALF
    samples = sample_surface(mesh, step)
    limit = half * (1 - overlap) - step
    uncovered = Uncovered(samples, limit, half - step)
    grids: list[MapletGrid] = []
    index = 0
    while index >= 0:
        normal = uncovered.mean_normal(index, half)
        grid = MapletGrid.facing(samples.points[index], normal, gsd, half_size)
        grids.append(grid)
        index = uncovered.cover(grid, index)
    return grids
