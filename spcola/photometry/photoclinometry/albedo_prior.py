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
    """The albedo of a cell is drawn to 1, and to that of its neighbours.

    A Gaussian Markov random field (Rue & Held 2005, *Gaussian Markov Random Fields*): bright and
    dark areas are drawn to 1 only weakly, while cells next to each other differ little. With
    independent cells the sigma must be large enough for the contrast between areas, and noise and
    relief within cells become albedo; or it is small, and areas become relief.

    Parameters
    ----------
    sigma : float
        Of a cell about 1, its neighbours left aside: its weight is 1 / sigma². With neighbours
        cells scatter by less: by 0.043 with the default sigmas.
    step_sigma : float
        Standard deviation of a cell about the mean of the eight around it; at the edges about fewer
        with the same weight each. Infinite: cells are independent.
    """

    sigma: float
    step_sigma: float = float("inf")

    def about(self, albedo: FloatArray) -> ExpectedAlbedo:
        """Return the prior of each cell of an albedo (R − 1, C − 1), its neighbours as they are.

        Cells are solved one by one. Solved again and again with the neighbours of the round before
        they come to the solution of all cells at once.
        """
        share, drawn = self._share, (1.0 - albedo) * self.sigma**-2
        if not share:
            return ExpectedAlbedo(np.full(albedo.shape, self.sigma**-2), drawn)
        count = _neighbours(albedo.shape)
        around = ndimage.convolve(albedo, _AROUND, mode="constant")
        return ExpectedAlbedo(
            self.sigma**-2 + share * count,
            drawn + share * (around - count * albedo),
        )

    def among_neighbours(self, own: FloatArray) -> ExpectedAlbedo:
        """Return the prior of each cell, its neighbours as well known as images determine them.

        For sigmas: neighbours that no image shows determine a cell less than those that many show.
        The information is one over the variance of the cell in the field, less that of its own
        images. Right-hand sides are 0.

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
        # The albedo of cells in place of heights of points: a matrix of the same shape, to which
        # cells between them add nothing.
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
