"""A covering of a body with maplet grids, made from its shape."""

from __future__ import annotations

import numpy as np

from spcola.arrays import BoolArray
from spcola.errors import InvalidValueError
from spcola.grids import MapletGrid
from spcola.shape.mesh import Mesh
from spcola.shape.rays import RayCaster
from spcola.shape.samples import Samples, sample_surface
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
    step = sample_step(half, overlap)
    return covering_grids(sample_surface(mesh, step), gsd, half_size, (step, overlap))


def sample_step(half: float, margin: float, per_half: int = SAMPLES_PER_HALF) -> float:
    """Return the distance of samples, metres, for grids of half a side `half`, metres.

    Parameters
    ----------
    half : float
    margin : float
        Share of the half-side by which a sample has to lie inside the rim.
    per_half : int
        Samples along what is left of the half-side.
    """
    return half * (1 - margin) / per_half


def covering_grids(
    samples: Samples,
    gsd: float,
    half_size: int,
    inside: tuple[float, float],
    *,
    wanted: BoolArray | None = None,
    smooth: float = 1.0,
) -> list[MapletGrid]:
    """Return grids such that every wanted sample lies in at least one.

    Parameters
    ----------
    samples : Samples
    gsd, half_size
        As in :func:`covering`.
    inside : (float, float)
        How far any surface point is from a sample, metres, and the share of the half-side by
        which each wanted one lies inside the rim of a grid.
    wanted : (N,) bool ndarray, optional
        Samples that are to be covered, at least one; all if not given.
    smooth : float
        Radius of the ground whose mean normal a grid faces, half sides.
    """
    half = gsd * half_size
    step, margin = inside
    uncovered = Uncovered(samples, half * (1 - margin) - step, half - step, wanted)
    grids: list[MapletGrid] = []
    index = 0 if wanted is None else _middle(samples, wanted)
    while index >= 0:
        normal = uncovered.mean_normal(index, smooth * half)
        grid = MapletGrid.facing(samples.points[index], normal, gsd, half_size)
        grids.append(grid)
        index = uncovered.cover(grid, index)
    return grids


def _middle(samples: Samples, wanted: BoolArray) -> int:
    """Return the wanted sample nearest to the mean of all of them: the middle of a region."""
    numbers = np.flatnonzero(wanted)
    points = samples.points[numbers]
    apart = np.linalg.norm(points - points.mean(axis=0), axis=1)
    return int(numbers[np.argmin(apart)])
