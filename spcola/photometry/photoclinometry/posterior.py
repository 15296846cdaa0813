"""Variances of heights and of what follows from them in cells, errors of nuisances included."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spcola.arrays import BoolArray, FloatArray
from spcola.compilation import compiled


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
        variance = _within(self.near, by_corner)
        by_corner = np.ascontiguousarray(np.broadcast_to(by_corner, (4, *variance.shape)))
        # It falls with heights, which fall with nuisance parameters.
        own = self._of_independent(direct) if len(direct) else direct
        _add_squares(self._by_independent, by_corner, own, variance)
        return variance

    @cached_property
    def _by_independent(self) -> FloatArray:
        """How much heights (P, R, C) fall with independent parameters of unit sigma, metres."""
        return self._of_independent(self.by_nuisance)

    @cached_property
    def _independent(self) -> FloatArray:
        """Matrix (P, P) from rows by nuisance parameters to those by independent ones."""
        fixed, free = self.considered, ~self.considered
        # The square of its inverse is the information on the estimated parameters.
        root = np.linalg.inv(np.linalg.cholesky(self.information[np.ix_(free, free)]))
        found = np.zeros(self.information.shape)
        found[np.ix_(free, free)] = root
        found[fixed, fixed] = self.sigma
        common = self.information[np.ix_(fixed, free)] @ root.T
        found[np.ix_(fixed, free)] = -self.sigma * common @ root
        return found

    def _of_independent(self, rows: FloatArray) -> FloatArray:
        """Return rows (P, …) by independent parameters from (Q, …) by the first Q nuisance ones."""
        flat = rows.reshape(len(rows), rows[0].size if len(rows) else 0)
        found = self._independent[:, : len(rows)] @ flat
        return found.reshape(-1, *rows.shape[1:])


@compiled
def _add_squares(
    rows: FloatArray, by_corner: FloatArray, direct: FloatArray, variance: FloatArray
) -> None:
    """Add to `variance` (R − 1, C − 1) the squares of a quantity's change with each parameter.

    Parameters
    ----------
    rows : (P, R, C) ndarray
        How much heights fall with the parameters.
    by_corner : (4, R − 1, C − 1) ndarray
        How much the quantity of a cell falls with the heights of its corners.
    direct : (P, R − 1, C − 1) or (0, …) ndarray
        How much it falls with the parameters where heights stay.
    variance : (R − 1, C − 1) ndarray
    """
    unmoved = np.zeros(variance.shape[1])
    for k in range(rows.shape[0]):
        for i in range(variance.shape[0]):
            above, below, shares, out = rows[k, i], rows[k, i + 1], by_corner[:, i], variance[i]
            own = direct[k, i] if direct.shape[0] else unmoved
            for j in range(out.size):
                change = shares[0, j] * above[j] + shares[1, j] * above[j + 1] - own[j]
                change += shares[2, j] * below[j] + shares[3, j] * below[j + 1]
                out[j] += change * change


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
