"""What is expected of the relative albedo of cells before any image is seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray
from spcola.compilation import compiled
from spcola.photometry.photoclinometry.cell_surface import CellInformation, CellSurface

# Steps to four of the eight neighbours of a cell, rows and columns: the others have this cell for
# such a neighbour. In the order in which a `CellSurface` has neighbouring points.
_NEIGHBOURS = ((0, 1), (1, -1), (1, 0), (1, 1))
# Departure from what is expected, in its sigmas, at which it has half of its weight.
_HALF_WEIGHT = 2.0


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

    Both are drawn with Cauchy's weight: an area of several times the albedo around it has a border
    that is far beyond what neighbours differ by, and its cells are far from 1. With Gaussian priors
    its brightness would count as an outlier of the images.

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
        own, between = self._weights(albedo)
        information, right = own.copy(), own * (1.0 - albedo)
        if self._share:
            _draw_to_neighbours(albedo, between, information, right)
        return ExpectedAlbedo(information, right)

    def among_neighbours(self, own: FloatArray, albedo: FloatArray) -> ExpectedAlbedo:
        """Return the prior of each cell, its neighbours as well known as images determine them.

        For sigmas: neighbours that no image shows determine a cell less than those that many show.
        The information is one over the variance of the cell in the field, less that of its own
        images. Right-hand sides are 0.

        Parameters
        ----------
        own : (R − 1, C − 1) ndarray
            Information of the images on the albedo of each cell.
        albedo : (R − 1, C − 1) ndarray
            As it was found: it has the weights.
        """
        alone, between = self._weights(albedo)
        nothing, shape = np.zeros(own.shape), own.shape
        if not self._share:
            return ExpectedAlbedo(alone, nothing)
        information = alone.copy()
        _draw_to_neighbours(albedo, between, information, nothing.copy())
        # The albedo of cells in place of heights of points: a matrix of the same shape, to which
        # cells between them add nothing.
        cells = (shape[0] - 1, shape[1] - 1)
        no_cells = CellInformation(
            np.zeros((6, *cells)), np.zeros((3, *cells)),
            np.zeros((0, *shape)), np.zeros((0, 0)), np.zeros(0),
        )  # fmt: skip
        known = np.concatenate([(own + information)[None], -between])
        field = CellSurface(no_cells, 1.0, known, nothing, np.zeros(cells))
        variance = field.posterior().heights()
        return ExpectedAlbedo(1.0 / variance - own, nothing)

    def _weights(self, albedo: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the information on each cell (R − 1, C − 1), and that on its differences.

        The latter (4, R − 1, C − 1) are those from four neighbours: 0 where the grid has none.
        """
        own, between = np.empty(albedo.shape), np.zeros((len(_NEIGHBOURS), *albedo.shape))
        _weigh(albedo, self.sigma**-2, self._share, own, between)
        return own, between

    @property
    def _share(self) -> float:
        """Information on the difference of two neighbours."""
        return float(self.step_sigma**-2 / (2 * len(_NEIGHBOURS)))


@compiled
def _weighted(departure: float, information: float) -> float:
    """Return information with Cauchy's weight at a departure from what is expected."""
    return information / (1.0 + departure * departure * information / _HALF_WEIGHT**2)


@compiled
def _weigh(
    albedo: FloatArray, single: float, share: float, own: FloatArray, between: FloatArray
) -> None:
    """Fill the information on cells, and on their differences from four neighbours."""
    down, across = albedo.shape
    for i in range(down):
        for j in range(across):
            own[i, j] = _weighted(1.0 - albedo[i, j], single)
            for k in range(len(_NEIGHBOURS)):
                row, column = i + _NEIGHBOURS[k][0], j + _NEIGHBOURS[k][1]
                if row < down and 0 <= column < across:
                    step = albedo[row, column] - albedo[i, j]
                    between[k, i, j] = _weighted(step, share)


@compiled
def _draw_to_neighbours(
    albedo: FloatArray, between: FloatArray, information: FloatArray, right: FloatArray
) -> None:
    """Add the differences from all eight neighbours, weighted by `between`."""
    down, across = albedo.shape
    for i in range(down):
        for j in range(across):
            for k in range(len(_NEIGHBOURS)):
                row, column = i + _NEIGHBOURS[k][0], j + _NEIGHBOURS[k][1]
                if row < down and 0 <= column < across:
                    weight = between[k, i, j]
                    pull = weight * (albedo[row, column] - albedo[i, j])
                    information[i, j] += weight
                    information[row, column] += weight
                    right[i, j] += pull
                    right[row, column] -= pull
