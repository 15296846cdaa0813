"""Variances of heights and of what follows from them in cells, errors of nuisances included."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from spcola.arrays import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class Posterior:
    """Covariances of heights of a grid that lie next to each other.

    Parameters
    ----------
    near : (5, R, C) ndarray
        Covariance, m², of each height with itself and with the points next to it, below left,
        below, and below right, if the P nuisance parameters were known.
    by_nuisance : (P, R, C) ndarray
        How much heights fall, metres, with each of the nuisance parameters.
    information : (P, P) ndarray
        On the nuisance parameters, heights eliminated.
    considered : (P,) ndarray of bool
        Nuisance parameters that are not estimated: heights are solved as if they were 0, and their
        errors change the heights by all of their effect (Schmidt 1966).
    sigma : float
        Standard deviation of each of these.
    """

    near: FloatArray
    by_nuisance: FloatArray
    information: FloatArray
    considered: BoolArray
    sigma: float

    def heights(self) -> FloatArray:
        """Return the variances (R, C), m²."""
        return self.near[0] + self._common(self.by_nuisance)

    def cells(self, weights: FloatArray, direct: FloatArray, gsd: float) -> FloatArray:
        """Return the variances (R − 1, C − 1) of a quantity of cells that falls with heights.

        Parameters
        ----------
        weights : (3, R − 1, C − 1) ndarray
            How much it falls with the slopes ∂h/∂x and ∂h/∂y, and with the mean height.
        direct : (Q, R − 1, C − 1) ndarray
            How much it falls with the first Q nuisance parameters where heights stay.
        gsd : float
            Metres.
        """
        x, y, mean = weights * np.array([0.5 / gsd, 0.5 / gsd, 0.25])[:, None, None]
        # By the corners 00, 01, 10, 11.
        by_corner = np.stack([mean - x - y, mean + x - y, mean - x + y, mean + x + y])
        rows = np.zeros((len(self.by_nuisance), *x.shape))
        for share, corner in zip(by_corner, _corners(self.by_nuisance), strict=True):
            rows += share * corner
        # It falls with heights, which fall with nuisance parameters.
        rows[: len(direct)] -= direct
        return _within(self.near, by_corner) + self._common(rows)

    def _common(self, rows: FloatArray) -> FloatArray:
        """Return the variances (…) of what changes by `rows` (P, …) with nuisance parameters."""
        flat = rows.reshape(len(rows), rows[0].size if len(rows) else 0)
        if not len(rows):
            return np.zeros(rows.shape[1:])
        fixed, free = self.considered, ~self.considered
        root = np.linalg.cholesky(self.information[np.ix_(free, free)])
        by_free = solve_triangular(root, flat[free], lower=True, check_finite=False)
        common = solve_triangular(root, self.information[np.ix_(free, fixed)], lower=True)
        response = flat[fixed] - common.T @ by_free
        found = np.sum(by_free**2, axis=0) + self.sigma**2 * np.sum(response**2, axis=0)
        return found.reshape(rows.shape[1:])


def _corners(layers: FloatArray) -> tuple[FloatArray, ...]:
    """Return the values at the corners 00, 01, 10, 11 of the cells of layers (…, R, C)."""
    return (
        layers[..., :-1, :-1], layers[..., :-1, 1:], layers[..., 1:, :-1], layers[..., 1:, 1:]
    )  # fmt: skip


def _within(near: FloatArray, by_corner: FloatArray) -> FloatArray:
    """Return the variances of cells from the covariances of their corners."""
    first, second, third, fourth = by_corner
    alone, over, below_left, below, below_right = near
    found = np.zeros(first.shape)
    for share, own in zip(by_corner, _corners(alone), strict=True):
        found += share**2 * own
    found += 2.0 * (first * second * over[:-1, :-1] + third * fourth * over[1:, :-1])
    found += 2.0 * (first * third * below[:-1, :-1] + second * fourth * below[:-1, 1:])
    found += 2.0 * first * fourth * below_right[:-1, :-1]
    found += 2.0 * second * third * below_left[:-1, 1:]
    return found
