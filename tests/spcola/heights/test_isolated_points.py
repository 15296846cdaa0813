"""Points moved to another aggregate than their own: the conditions of the cycle's proof."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.compilation import Bands
from spcola.heights.isolated_points import IsolatedPoints
from spcola.heights.smoothing import Level


def level(rng, size, cuts):
    """Padded coefficients of a random mask whose edges are cut at random."""
    mask = rng.random((size, size)) < 0.7
    right, down, ground = np.zeros((3, size + 2, size + 2))
    right[1:-1, 1:-2] = (mask[:, 1:] & mask[:, :-1]) * (rng.random((size, size - 1)) > cuts)
    down[1:-2, 1:-1] = (mask[1:] & mask[:-1]) * (rng.random((size - 1, size)) > cuts)
    right[1:-1, 1:-2] *= rng.uniform(0.5, 2.0, (size, size - 1))
    down[1:-2, 1:-1] *= rng.uniform(0.5, 2.0, (size - 1, size))
    ground[1:-1, 1:-1] = mask * rng.uniform(0.0, 0.2, (size, size))
    return right, down, ground


def plain(fine, size):
    """Coefficients of the coarser level of 2 × 2 aggregates, edges halved, by loops."""
    coarse = tuple(np.zeros((size // 2 + 2, size // 2 + 2)) for _ in range(3))
    for i in range(1, size + 1):
        for j in range(1, size + 1):
            r, c = (i + 1) // 2, (j + 1) // 2
            coarse[0][r, c] += 0.5 * fine[0][i, j] * (j % 2 == 0)
            coarse[1][r, c] += 0.5 * fine[1][i, j] * (i % 2 == 0)
            coarse[2][r, c] += fine[2][i, j]
    return coarse


def matrix(coefficients):
    """Return the dense matrix over all padded points."""
    right, down, ground = coefficients
    width = right.shape[1]
    dense = np.diag(ground.ravel())
    for weights, apart in ((right, 1), (down, width)):
        for n in np.flatnonzero(weights):
            pair = np.zeros(dense.shape[0])
            pair[n], pair[n + apart] = 1.0, -1.0
            dense += weights.flat[n] * np.outer(pair, pair)
    return dense


def leads(size, place):
    """Return P: one at the aggregate that leads each point."""
    led = np.zeros((size + 2, size + 2, (size // 2 + 2) ** 2))
    for i in range(1, size + 1):
        for j in range(1, size + 1):
            led[i, j, (i + 1) // 2 * (size // 2 + 2) + (j + 1) // 2] = 1.0
    for i, j, r, c in place:
        led[i, j] = 0.0
        led[i, j, r * (size // 2 + 2) + c] = 1.0
    return led.reshape((size + 2) ** 2, -1)


def smoothing(fine, size):
    """Return what black, then red smoothing makes of all values, as a matrix."""
    dense = matrix(fine)
    red = np.indices((size + 2, size + 2)).sum(axis=0).ravel() % 2 == 0
    whole = np.eye(len(dense))
    for colour in (~red, red):
        share = np.divide(1.0, np.diag(dense), out=np.zeros(len(dense)), where=np.diag(dense) > 0)
        whole -= (share * colour)[:, None] * (dense @ whole)
    return whole


@pytest.mark.parametrize("cuts", [0.0, 0.2, 0.5])
def test_isolated_points_keep_the_cycle_positive(cuts):
    """The coarse matrix is at least ½ PᵀAP, carries constants, and leaves no negative weight."""
    size, found = 12, 0
    for seed in range(6):
        fine = level(np.random.default_rng(seed), size, cuts)
        coarse = plain(fine, size)
        isolated = IsolatedPoints.reassign(Level(*fine), Level(*coarse), Bands(size**2, 1))
        found += len(isolated.place)
        assert min(each.min() for each in coarse) >= 0
        assert coarse[2].sum() == pytest.approx(fine[2].sum())
        moved = smoothing(fine, size) @ leads(size, isolated.place)
        # A black point may follow any aggregate: it is smoothed before it counts.
        low = np.linalg.eigvalsh(matrix(coarse) - 0.5 * moved.T @ matrix(fine) @ moved)
        assert low[0] > -1e-12
    assert found > 0


def test_isolated_points_move_as_the_prolongation_does():
    """Restriction and correction are those of the smoothed P with moved rows."""
    size, rng = 12, np.random.default_rng(1)
    fine = level(rng, size, 0.2)
    coarse = plain(fine, size)
    isolated = IsolatedPoints.reassign(Level(*fine), Level(*coarse), Bands(size**2, 1))
    change = smoothing(fine, size) @ (leads(size, isolated.place) - leads(size, []))
    value, source = rng.normal(size=coarse[0].shape), rng.normal(size=fine[0].shape)
    answer, residual = np.zeros_like(source), np.zeros_like(value)
    isolated.correct(value, answer)
    isolated.restrict(source, residual)
    np.testing.assert_allclose(answer.ravel(), change @ value.ravel(), atol=1e-12)
    np.testing.assert_allclose(residual.ravel(), source.ravel() @ change, atol=1e-12)
