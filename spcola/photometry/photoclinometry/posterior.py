"""Variances of heights and of what follows from them in cells, errors of nuisances included."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

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
        return self.near[0] + np.sum(self._by_independent**2, axis=0)

    def slopes(self, gsd: float) -> FloatArray:
        """Return the variances (2, R − 1, C − 1) of the slopes ∂h/∂x and ∂h/∂y of cells."""
        along_x, along_y = np.eye(3)[:2, :, None, None]
        unmoved = np.zeros((0, 1, 1))
        return np.stack([self.cells(one, unmoved, gsd) for one in (along_x, along_y)])

    def cells(self, weights: FloatArray, direct: FloatArray, gsd: float) -> FloatArray:
        """Return the variances (R − 1, C − 1) of a quantity of cells that falls with heights.

        Parameters
        ----------
        weights : (3, R − 1, C − 1) or (3, 1, 1) ndarray
            How much it falls with the slopes ∂h/∂x and ∂h/∂y, and with the mean height.
        direct : (Q, R − 1, C − 1) ndarray
            How much it falls with the first Q nuisance parameters where heights stay.
        gsd : float
            Metres.
        """
        x, y, mean = weights * np.array([0.5 / gsd, 0.5 / gsd, 0.25])[:, None, None]
        # By the corners 00, 01, 10, 11.
        by_corner = np.stack([mean - x - y, mean + x - y, mean - x + y, mean + x + y])
        corners = zip(by_corner, _corners(self._by_independent), strict=True)
        rows = sum(share * corner for share, corner in corners)
        if len(direct):
            # It falls with heights, which fall with nuisance parameters.
            all_direct = np.zeros((len(self.information), *direct.shape[1:]))
            all_direct[: len(direct)] = direct
            rows = rows - self._of_independent(all_direct)
        return _within(self.near, by_corner) + np.sum(rows**2, axis=0)

    @cached_property
    def _by_independent(self) -> FloatArray:
        """How much heights (P, R, C) fall with independent parameters of unit sigma, metres."""
        return self._of_independent(self.by_nuisance)

    @cached_property
    def _root(self) -> FloatArray:
        """Lower triangle of which the information on the estimated parameters is the square."""
        free = ~self.considered
        return np.linalg.cholesky(self.information[np.ix_(free, free)])

    def _of_independent(self, rows: FloatArray) -> FloatArray:
        """Return rows (P, …) by nuisance parameters as rows by independent ones of unit sigma."""
        flat = rows.reshape(len(rows), rows[0].size if len(rows) else 0)
        fixed, free = self.considered, ~self.considered
        found = np.empty_like(flat)
        found[free] = solve_triangular(self._root, flat[free], lower=True, check_finite=False)
        common = solve_triangular(self._root, self.information[np.ix_(free, fixed)], lower=True)
        found[fixed] = self.sigma * (flat[fixed] - common.T @ found[free])
        return found.reshape(rows.shape)


def _corners(layers: FloatArray) -> tuple[FloatArray, ...]:
    """Return the values at the corners 00, 01, 10, 11 of the cells of layers (…, R, C)."""
    return (
        layers[..., :-1, :-1], layers[..., :-1, 1:], layers[..., 1:, :-1], layers[..., 1:, 1:]
    )  # fmt: skip


def _within(near: FloatArray, by_corner: FloatArray) -> FloatArray:
    """Return the variances of cells from the covariances of their corners."""
    first, second, third, fourth = by_corner
    alone, over, below_left, below, below_right = near
    found = np.zeros(alone[1:, 1:].shape)
    for share, own in zip(by_corner, _corners(alone), strict=True):
        found += share**2 * own
    found += 2.0 * (first * second * over[:-1, :-1] + third * fourth * over[1:, :-1])
    found += 2.0 * (first * third * below[:-1, :-1] + second * fourth * below[:-1, 1:])
    found += 2.0 * first * fourth * below_right[:-1, :-1]
    found += 2.0 * second * third * below_left[:-1, 1:]
    return found
