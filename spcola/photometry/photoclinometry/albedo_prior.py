"""What is expected of the relative albedo of cells before any image is seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from spcola.arrays import FloatArray
from spcola.photometry.photoclinometry.cell_surface import CellInformation, CellSurface

_AROUND = np.array([[1.0, 1.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 1.0]])


@dataclass(frozen=True, eq=False)
class ExpectedAlbedo:
    """Prior equations of the albedo of each cell.

    Parameters
    ----------
    information : (R − 1, C − 1) ndarray
        On the albedo.
    right : (R − 1, C − 1) ndarray
        Right-hand sides for its change.
    """

    information: FloatArray
    right: FloatArray


@dataclass(frozen=True)
class AlbedoPrior:
    """The albedo of a cell is about 1, and close to that of its neighbours.

    A Gaussian Markov random field (Rue & Held 2005, *Gaussian Markov Random Fields*). Bright and
    dark areas may differ by `sigma` from the mean, while cells next to each other differ little:
    independent cells would have to be allowed as much from one to the next, and noise and relief
    within cells would become albedo, or would have to be held to less than areas differ, and areas
    would become relief.

    Parameters
    ----------
    sigma : float
        Standard deviation about 1.
    step_sigma : float
        Standard deviation of a cell about the mean of the eight around it. Infinite: cells are
        independent.
    """

    sigma: float
    step_sigma: float = float("inf")

    def about(self, albedo: FloatArray) -> ExpectedAlbedo:
        """Return the prior of each cell of an albedo (R − 1, C − 1), its neighbours as they are.

        Cells are solved one by one. Solved again and again with the neighbours of the round before
        they come to the solution of all cells at once.
        """
        share, count = self._share, _neighbours(albedo.shape)
        around = ndimage.convolve(albedo, _AROUND, mode="constant")
        return ExpectedAlbedo(
            self.sigma**-2 + share * count,
            (1.0 - albedo) * self.sigma**-2 + share * (around - count * albedo),
        )

    def among_neighbours(self, own: FloatArray) -> ExpectedAlbedo:
        """Return the prior of each cell, its neighbours as well known as images determine them.

        For sigmas: neighbours that no image shows say less of a cell than those that many show. The
        information is what the variance of a cell in the field of all of them is beyond its own.
        Right-hand sides are 0.

        Parameters
        ----------
        own : (R − 1, C − 1) ndarray
            Information of the images on the albedo of each cell.
        """
        share, shape = self._share, own.shape
        if not share:
            return ExpectedAlbedo(np.full(shape, self.sigma**-2), np.zeros(shape))
        known = np.zeros((5, *shape))
        known[0] = own + self.sigma**-2 + share * _neighbours(shape)
        known[1, :, :-1] = -share
        known[2, :-1, 1:] = -share
        known[3, :-1] = -share
        known[4, :-1, :-1] = -share
        between = (shape[0] - 1, shape[1] - 1)
        nothing = CellInformation(
            np.zeros((6, *between)), np.zeros((3, *between)),
            np.zeros((0, *shape)), np.zeros((0, 0)), np.zeros(0),
        )  # fmt: skip
        field = CellSurface(nothing, 1.0, known, np.zeros(shape), np.zeros(between))
        variance = field.posterior().heights()
        return ExpectedAlbedo(1.0 / variance - own, np.zeros(shape))

    @property
    def _share(self) -> float:
        """Information on the difference of two neighbours."""
        return float(self.step_sigma**-2 / _AROUND.sum())


def _neighbours(shape: tuple[int, ...]) -> FloatArray:
    """Return how many neighbours each cell has: eight, less at the edges."""
    return np.asarray(ndimage.convolve(np.ones(shape), _AROUND, mode="constant"))
