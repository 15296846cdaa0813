"""Heights from cells: against the dense normal matrix."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.photometry.photoclinometry.cell_surface import CellInformation, CellSurface

RNG = np.random.default_rng(5)
SHAPE, GSD, NUISANCES = (6, 8), 0.5, 3
CELLS = (5, 7)
# From a point to itself, the next, below left, below, below right.
APART = (0, 1, SHAPE[1] - 1, SHAPE[1], SHAPE[1] + 1)


def rows_of(i, j):
    """∂h/∂x, ∂h/∂y, mean and twist of a cell as rows over all points."""
    rows = np.zeros((4, *SHAPE))
    rows[0, i : i + 2, j : j + 2] = np.array([[-1, 1], [-1, 1]]) / (2 * GSD)
    rows[1, i : i + 2, j : j + 2] = np.array([[-1, -1], [1, 1]]) / (2 * GSD)
    rows[2, i : i + 2, j : j + 2] = 0.25
    rows[3, i : i + 2, j : j + 2] = [[1, -1], [-1, 1]]
    return rows.reshape(4, -1)


@pytest.fixture(scope="module")
def dense():
    """Random information, its dense matrix and right-hand side, nuisance parameters included."""
    points, upper = SHAPE[0] * SHAPE[1], np.triu_indices(3)
    matrix, right = np.zeros((points + NUISANCES,) * 2), np.zeros(points + NUISANCES)
    normal, pull = np.zeros((6, *CELLS)), RNG.normal(size=(3, *CELLS))
    coupled = 0.3 * RNG.normal(size=(NUISANCES, *SHAPE))
    known, heights = RNG.uniform(0.0, 0.1, (5, *SHAPE)), RNG.normal(size=SHAPE)
    known[0] += 1.0
    twist = RNG.uniform(0.5, 1.0, CELLS)
    for apart, diagonal in zip(APART, known, strict=True):
        rows = np.arange(points - apart)
        matrix[rows, rows + apart] += diagonal.ravel()[: points - apart]
        matrix[rows + apart, rows] += (apart > 0) * diagonal.ravel()[: points - apart]
    right[:points] += heights.ravel()
    for i in range(CELLS[0]):
        for j in range(CELLS[1]):
            root, rows = RNG.normal(size=(3, 3)), rows_of(i, j)
            own = root @ root.T
            normal[:, i, j] = own[upper]
            matrix[:points, :points] += rows[:3].T @ own @ rows[:3]
            matrix[:points, :points] += twist[i, j] * np.outer(rows[3], rows[3])
            right[:points] += rows[:3].T @ pull[:, i, j]
    matrix[points:, :points] = coupled.reshape(NUISANCES, -1)
    matrix[:points, points:] = coupled.reshape(NUISANCES, -1).T
    nuisance = 60.0 * np.eye(NUISANCES) + 1.0
    matrix[points:, points:] = nuisance
    right[points:] = RNG.normal(size=NUISANCES)
    assert np.linalg.eigvalsh(matrix)[0] > 0.0
    cells = CellInformation(normal, pull, coupled, nuisance, right[points:])
    return CellSurface(cells, GSD, known, heights, twist), matrix, right


def test_heights_and_nuisance_parameters_solve_the_dense_equations(dense):
    surface, matrix, right = dense
    heights, nuisance = surface.solve(tolerance=1e-6)
    exact = np.linalg.solve(matrix, right)
    np.testing.assert_allclose(heights.ravel(), exact[: heights.size], atol=2e-3)
    np.testing.assert_allclose(nuisance, exact[heights.size :], atol=2e-3)


def test_variances_are_those_of_the_dense_inverse(dense):
    surface, matrix, _ = dense
    exact = np.diag(np.linalg.inv(matrix))[: SHAPE[0] * SHAPE[1]]
    np.testing.assert_allclose(surface.posterior().heights().ravel(), exact, rtol=1e-9)


def test_variances_with_a_parameter_that_is_not_estimated(dense):
    """Heights are solved without it; an error of it changes them by what the equations state."""
    surface, matrix, _ = dense
    points, sigma = SHAPE[0] * SHAPE[1], 0.7
    fixed = np.array([False, True, False])
    free = np.concatenate([np.ones(points, dtype=bool), ~fixed])
    inverse = np.linalg.inv(matrix[np.ix_(free, free)])
    response = (inverse @ matrix[np.ix_(free, ~free)])[:points]
    exact = np.diag(inverse)[:points] + sigma**2 * np.sum(response**2, axis=1)
    found = surface.posterior(fixed, sigma).heights()
    np.testing.assert_allclose(found.ravel(), exact, rtol=1e-9)
    none = surface.posterior(fixed, 0.0).heights().ravel()
    np.testing.assert_allclose(none, np.diag(inverse)[:points], rtol=1e-9)


def test_variances_of_cells_are_those_of_the_dense_inverse(dense):
    """What falls with slopes, heights and nuisance parameters; one of these is not estimated."""
    surface, matrix, _ = dense
    points, sigma, used = SHAPE[0] * SHAPE[1], 0.7, 2
    weights, direct = RNG.normal(size=(3, *CELLS)), RNG.normal(size=(used, *CELLS))
    rows = np.zeros((CELLS[0] * CELLS[1], points + NUISANCES))
    for number, (i, j) in enumerate(np.ndindex(*CELLS)):
        rows[number, :points] = weights[:, i, j] @ rows_of(i, j)[:3]
        rows[number, points : points + used] = direct[:, i, j]
    fixed = np.array([False, True, False])
    free = np.concatenate([np.ones(points, dtype=bool), ~fixed])
    inverse = np.linalg.inv(matrix[np.ix_(free, free)])
    by_fixed = rows[:, ~free] - rows[:, free] @ inverse @ matrix[np.ix_(free, ~free)]
    exact = np.einsum("na,ab,nb->n", rows[:, free], inverse, rows[:, free])
    exact += sigma**2 * np.sum(by_fixed**2, axis=1)
    posterior = surface.posterior(fixed, sigma)
    found = posterior.cells(weights, direct, GSD)
    np.testing.assert_allclose(found.ravel(), exact, rtol=1e-9)
    # Slopes are such quantities, without a part that nuisance parameters change alone.
    for axis, one in enumerate(posterior.slopes(GSD)):
        weights = np.zeros((3, *CELLS))
        weights[axis] = 1.0
        alone = posterior.cells(weights, np.zeros((used, *CELLS)), GSD)
        np.testing.assert_allclose(one, alone, rtol=1e-9)


def test_a_direction_of_the_slope_enters_and_the_other_does_not():
    """Slopes along a diagonal are known; heights along the other diagonal stay with the points."""
    normal, right = np.zeros((6, *CELLS)), np.zeros((3, *CELLS))
    normal[0], normal[1], normal[3] = 1e6, 1e6, 1e6
    slope = 0.2
    right[0] = right[1] = 1e6 * slope
    empty = CellInformation(normal, right, np.zeros((0, *SHAPE)), np.zeros((0, 0)), np.zeros(0))
    y, x = np.indices(SHAPE) * GSD
    across = 0.05 * (x - y)
    known = np.zeros((5, *SHAPE))
    known[0] = 1e-3
    surface = CellSurface(empty, GSD, known, known[0] * across, np.full(CELLS, 1e-6))
    found, _ = surface.solve(tolerance=1e-6)
    rise = 0.5 * slope * (x + y)
    for k in range(1 - SHAPE[0], SHAPE[1]):
        # Each diagonal has the mean of its points' own heights.
        here = np.eye(*SHAPE, k=k, dtype=bool)
        rise[here] -= rise[here].mean()
    np.testing.assert_allclose(found, across + rise, atol=1e-3)
