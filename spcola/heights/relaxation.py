"""The published relaxation at random points: the reference of the fast solver."""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray, IntArray, check_shape
from spcola.compilation import compiled
from spcola.errors import InvalidValueError
from spcola.heights.problem import HeightProblem


def relax(
    problem: HeightProblem,
    *,
    sweeps: int,
    seed: int,
    start: FloatArray | None = None,
) -> FloatArray:
    """Relax heights at points chosen at random (Gaskell et al., eq. 23).

    One update sets a point to the weighted mean of the values from its valid neighbours and its
    constraint. The 4 in the published denominator is the number of neighbours in the
    middle of a maplet; here it is the sum of the weights of the edges that are there. It needs
    on the order of N² updates for N points: for small grids only.

    Parameters
    ----------
    problem : HeightProblem
        With all weights of edges 1 it is the published relaxation.
    sweeps : int
        Updates, in units of the number of points of the mask.
    seed : int
        Seed of the generator that chooses the points.
    start : (R, C) ndarray, optional
        First heights, metres; 0 if not given.

    Returns
    -------
    (R, C) ndarray
        Heights, metres; NaN outside the mask.

    Raises
    ------
    InvalidValueError
        If `start` has another shape, or the problem has constraints on means.
    """
    if problem.means is not None:
        raise InvalidValueError("means are not relaxed", "problem", "use solve_heights")
    height = np.zeros(problem.shape)
    if start is not None:
        check_shape(start, problem.shape, "start")
        height = np.nan_to_num(start)
    points = np.argwhere(problem.mask)
    rng = np.random.default_rng(seed)
    for _ in range(sweeps):
        _relax_points(
            points[rng.integers(len(points), size=len(points))],
            (problem.step_x, problem.step_y, problem.weight_x, problem.weight_y),
            (problem.height, problem.weight),
            height,
        )
    height[~problem.mask] = np.nan
    return height


@compiled
def _relax_points(
    points: IntArray,
    edges: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    constraints: tuple[FloatArray, FloatArray],
    height: FloatArray,
) -> None:
    """Apply eq. 23 at each of `points` (n, 2), in their order."""
    (step_x, step_y, weight_x, weight_y), (constraint, weight) = edges, constraints
    rows, columns = height.shape
    for k in range(len(points)):
        r, c = points[k, 0], points[k, 1]
        total = weight[r, c]
        pull = total * constraint[r, c] if total > 0 else 0.0
        if c + 1 < columns and weight_x[r, c] > 0:
            total += weight_x[r, c]
            pull += weight_x[r, c] * (height[r, c + 1] - step_x[r, c])
        if c > 0 and weight_x[r, c - 1] > 0:
            total += weight_x[r, c - 1]
            pull += weight_x[r, c - 1] * (height[r, c - 1] + step_x[r, c - 1])
        if r + 1 < rows and weight_y[r, c] > 0:
            total += weight_y[r, c]
            pull += weight_y[r, c] * (height[r + 1, c] - step_y[r, c])
        if r > 0 and weight_y[r - 1, c] > 0:
            total += weight_y[r - 1, c]
            pull += weight_y[r - 1, c] * (height[r - 1, c] + step_y[r - 1, c])
        if total > 0:
            height[r, c] = pull / total
