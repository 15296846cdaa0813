"""Heights of returns above an SPC surface at their own positions, averaged over cells.

A return's height above the surface is evaluated at its position by a cubic spline. The differences,
not the heights, are averaged over cells: they are small and smooth, so that slopes within a cell
cause no error. Errors, resolution and weights of the surface refer to cells.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fusion.registration.direct import SurfacePair
from fusion.surfacematch import Surface, accurate_variance, spline_at, spline_coefficients
from fusion.surfacematch.resolution import blur
from spcola.arrays import BoolArray, FloatArray
from spcola.compilation import compiled
from spcola.grids import MapletGrid
from spcola.grids.gaps import filled
from spcola.math import Affine
from spcola.math.robust import huber_weight, mad

# Robust standard deviations from the surface beyond which a return is an outlier.
_OUTLIER = 8.0


@dataclass(frozen=True, eq=False)
class CloudOfReturns:
    """N returns near one SPC surface.

    Parameters
    ----------
    points : (N, 3) ndarray
        Body-fixed, metres.
    sigma : (N,) ndarray
        One standard deviation of a return, metres; NaN where unknown.
    """

    points: FloatArray
    sigma: FloatArray

    def __len__(self) -> int:
        return len(self.points)


@dataclass(frozen=True, eq=False)
class FixedSurface:
    """An SPC surface with which returns are compared.

    Parameters
    ----------
    grid : MapletGrid
    surface : Surface
        Heights and sigmas on it.
    blur_cells : float
        Blur of the surface relative to the returns, cells; if negative the surface is the sharper
        one, and is blurred.
    """

    grid: MapletGrid
    surface: Surface
    blur_cells: float = 0.0

    @cached_property
    def height(self) -> FloatArray:
        """Heights (N, N), metres, at the resolution of the comparison."""
        if self.blur_cells >= 0:
            return self.surface.height
        return blur(self.surface.height, -self.blur_cells)

    @cached_property
    def known(self) -> BoolArray:
        """Mask (N, N) of grid points with a height."""
        mask: BoolArray = np.isfinite(self.height)
        return mask

    @cached_property
    def coefficients(self) -> FloatArray:
        """Coefficients (N + 4, N + 4) of the cubic spline through the heights."""
        return spline_coefficients(filled(self.height))


def height_of_returns(returns: CloudOfReturns, fixed: FixedSurface, transform: Affine) -> Surface:
    """Return the surface of moved returns on the grid, from their differences to the fixed one.

    Returns far from the surface are left out.

    Parameters
    ----------
    returns : CloudOfReturns
    fixed : FixedSurface
    transform : Affine
        From the returns' frame to that of the surface.

    Returns
    -------
    Surface
        On ``fixed.grid``: the fixed height minus the mean difference of the returns in the cell,
        NaN without returns; sigma of that mean, NaN if the returns' own is unknown.
    """
    grid = fixed.grid
    matrix = grid.axes @ transform.matrix
    offset = grid.axes @ (transform.translation - grid.center)
    sums, window = np.zeros((4, *grid.shape)), np.array([0.0, np.inf])
    for _ in range(2):
        sums = np.zeros((4, *grid.shape))
        _sum_up(
            returns.points,
            returns.sigma,
            (matrix, offset, window),
            grid.gsd,
            fixed.coefficients,
            fixed.known,
            sums,
        )
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = sums[1] / sums[0]
        middle = np.nanmedian(mean) if sums[0].any() else 0.0
        window = np.array([middle, _OUTLIER * float(mad(mean))])
    with np.errstate(invalid="ignore", divide="ignore"):
        sigma = np.where(sums[2] > 0, np.sqrt(sums[3]) / sums[0], np.nan)
    return Surface(np.where(sums[0] > 0, fixed.height - mean, np.nan), sigma)


def compared(lidar: Surface, fixed: FixedSurface) -> SurfacePair:
    """Bring a surface of returns to the fixed one's resolution, and compute weights.

    Weights follow from the sigmas of both, as in :func:`fusion.surfacematch.match_surfaces`, scaled
    to the observed differences; the robust ones are Huber's about the median.
    """
    moving = blur(lidar.height, fixed.blur_cells) if fixed.blur_cells > 0 else lidar.height
    difference = fixed.height - moving
    weight = relative_weight(lidar, fixed.surface)
    standard = (difference - np.nanmedian(difference)) * np.sqrt(weight)
    scale = max(float(mad(standard)), 1e-9)
    return SurfacePair(
        fixed.height, moving, weight / scale**2, huber_weight(standard / scale, k=2.0)
    )


def relative_weight(lidar: Surface, fixed: Surface) -> FloatArray:
    """Weights (N, N) relative to the most accurate differences, at most 1; 0 where unknown."""
    variance = lidar.variance + fixed.variance
    both = np.isfinite(lidar.height) & np.isfinite(fixed.height)
    if not (variance[both] > 0).any():
        return both.astype(np.float64)
    best = accurate_variance(variance[both])
    return np.where(both, 1.0 / np.maximum(variance / max(best, 1e-12), 1.0), 0.0)


@compiled
def _sum_up(
    points: FloatArray,
    sigma: FloatArray,
    placing: tuple[FloatArray, FloatArray, FloatArray],
    gsd: float,
    coefficients: FloatArray,
    known: BoolArray,
    sums: FloatArray,
) -> None:
    """Add each return's difference to the sums of its cell.

    `placing` are matrix and offset into the grid's frame, and the middle and half-width of the
    interval of accepted differences. The sums are of returns, differences, returns of known sigma,
    and variances.
    """
    matrix, offset, window = placing
    size = known.shape[0]
    middle = (size - 1) // 2
    for k in range(len(points)):
        a, b, c = points[k, 0], points[k, 1], points[k, 2]
        x = (matrix[0, 0] * a + matrix[0, 1] * b + matrix[0, 2] * c + offset[0]) / gsd + middle
        y = (matrix[1, 0] * a + matrix[1, 1] * b + matrix[1, 2] * c + offset[1]) / gsd + middle
        column, row = int(np.floor(x + 0.5)), int(np.floor(y + 0.5))
        if not (0 <= column < size and 0 <= row < size) or not known[row, column]:
            continue
        z = matrix[2, 0] * a + matrix[2, 1] * b + matrix[2, 2] * c + offset[2]
        difference = spline_at(coefficients, x, y) - z
        if abs(difference - window[0]) > window[1]:
            continue
        sums[0, row, column] += 1.0
        sums[1, row, column] += difference
        if sigma[k] > 0.0:
            sums[2, row, column] += 1.0
            sums[3, row, column] += sigma[k] * sigma[k]
