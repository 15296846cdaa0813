"""Along which axis slopes are not determined where images determine one direction of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import AnyArray, BoolArray, FloatArray
from spcola.grids import MapletGrid
from spcola.math import local_axes

# Of what is unknown of slopes, (1 + agreement)/2 is along the mean axis, as a variance: nine tenths
# here. The standard deviation along it is three times that across it.
_LEAST_AGREEMENT = 0.8
# Ten axes at random agree so well once in 600 times (Rayleigh: exp(−N agreement²)); fewer cells
# show nothing of the maplet.
_FEWEST_CELLS = 10


@dataclass(frozen=True)
class UndeterminedAxis:
    """Axis along which images do not determine slopes; across it they do.

    It is the mean over the cells of which images determine exactly one direction of the slope. An
    axis has no sense of direction: it is the same after half a turn.

    Attributes
    ----------
    angle : float
        From the grid's Ux towards Uy, 0 … π, radians; NaN where fewer than ten cells have one
        direction, or where they do not agree (`agreement` below 0.8).
    azimuth_deg : float
        The same axis in the plane of the grid, from north towards east, 0 … 180 degrees; NaN as
        `angle`. North is the body-fixed +Z in that plane, as of :func:`spcola.math.local_axes`.
    agreement : float
        Length of the mean of the cells' unit vectors of twice their angles: 1 where all have the
        same axis, 0 where axes lie all round; NaN without cells.
    share : float
        Of the cells of the grid that have one direction, 0 … 1.
    """

    angle: float = float("nan")
    azimuth_deg: float = float("nan")
    agreement: float = float("nan")
    share: float = 0.0

    @classmethod
    def of(cls, information: FloatArray, one: BoolArray, grid: MapletGrid) -> UndeterminedAxis:
        """Return the axis of a grid.

        Parameters
        ----------
        information : (3, R − 1, C − 1) ndarray
            On the slopes of cells: xx, xy and yy of ∂h/∂x and ∂h/∂y along Ux and Uy.
        one : (R − 1, C − 1) ndarray of bool
            Whether images determine exactly one direction of the slope of a cell.
        grid : MapletGrid
            Body-fixed.
        """
        if not one.any():
            return cls()
        doubled = _doubled(information[:, one])
        mean = complex(np.mean(doubled / np.abs(doubled)))
        agreement, share = abs(mean), float(np.mean(one))
        if np.count_nonzero(one) < _FEWEST_CELLS or agreement < _LEAST_AGREEMENT:
            return cls(agreement=agreement, share=share)
        angle = 0.5 * float(np.angle(mean)) % np.pi % np.pi
        return cls(angle, float(azimuths_of(np.array(angle), grid)), agreement, share)

    @property
    def known(self) -> bool:
        """Whether there is one."""
        return bool(np.isfinite(self.angle))

    @property
    def shown_azimuth(self) -> str:
        """Azimuth in whole degrees, 0 … 179, as text for people."""
        return f"{round(self.azimuth_deg) % 180}°"


def cell_azimuths(information: FloatArray, one: BoolArray, grid: MapletGrid) -> FloatArray:
    """Return the azimuth (R − 1, C − 1) along which the slope of each cell is not determined.

    Parameters
    ----------
    information, one, grid
        As of :meth:`UndeterminedAxis.of`.

    Returns
    -------
    (R − 1, C − 1) ndarray
        Degrees, 0 … 180, from north towards east; NaN where `one` is false.
    """
    found = np.full(one.shape, np.nan)
    found[one] = azimuths_of(0.5 * np.angle(_doubled(information[:, one])), grid)
    return found


def _doubled(information: FloatArray) -> AnyArray:
    """Return twice the angles (N,) of the undetermined axes, as arguments of complex numbers.

    They are those of the eigenvectors of the smaller eigenvalues. The eigenvalues differ, as only
    one of them reaches the limit.
    """
    xx, xy, yy = information
    doubled: AnyArray = (yy - xx) - 2j * xy
    return doubled


def azimuths_of(angle: FloatArray, grid: MapletGrid) -> FloatArray:
    """Return the azimuths of axes in the plane of a grid, from north to east, 0 … 180 degrees.

    Parameters
    ----------
    angle : ndarray
        Of the axes, from the grid's Ux towards Uy, radians.
    grid : MapletGrid
        Body-fixed.
    """
    south, east, _ = local_axes(grid.uz)
    along = np.cos(angle)[..., None] * grid.ux + np.sin(angle)[..., None] * grid.uy
    # The modulus of a rounding error below 0 is 180 itself.
    found: FloatArray = np.degrees(np.arctan2(along @ east, -(along @ south))) % 180.0 % 180.0
    return found
