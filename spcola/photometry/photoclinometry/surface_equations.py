"""From the sums over images to heights and albedo: albedo eliminated, priors, integration."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from spcola.arrays import AnyArray, BoolArray, FloatArray
from spcola.compilation import compiled
from spcola.photometry.ground import at_cells
from spcola.photometry.photoclinometry.albedo_convention import AlbedoConvention
from spcola.photometry.photoclinometry.albedo_equations import eliminate_albedo, with_priors
from spcola.photometry.photoclinometry.cell_pixels import NUISANCES
from spcola.photometry.photoclinometry.cell_surface import CellInformation, CellSurface
from spcola.photometry.photoclinometry.image_equations import Sums
from spcola.photometry.photoclinometry.options import PhotoclinometryOptions
from spcola.photometry.photoclinometry.surface import Surface, cell_slopes

# Where the six products of (∂h/∂x, ∂h/∂y, h) lie in the upper triangle with the albedo, and where
# their products with the albedo do.
_OWN, _WITH_ALBEDO = (0, 1, 2, 4, 5, 7), (3, 6, 8)
_PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


@dataclass(frozen=True, eq=False)
class Reduced:
    """Normal equations of all cells without their albedo.

    Attributes
    ----------
    cells : CellInformation
        Of images alone; nuisance parameters are five of each image.
    by_albedo : (3, R − 1, C − 1) ndarray
        Products of (∂h/∂x, ∂h/∂y, h) with the albedo, over the albedo's information: how much the
        albedo changes with them.
    albedo : (R − 1, C − 1) ndarray
        Change of the albedo where nothing else changes.
    albedo_by_nuisance : (P, R − 1, C − 1) ndarray
    albedo_weight : (R − 1, C − 1) ndarray
        Information on the albedo, prior included.
    """

    cells: CellInformation
    by_albedo: FloatArray
    albedo: FloatArray
    albedo_by_nuisance: FloatArray
    albedo_weight: FloatArray

    def of_cells(self, chosen: BoolArray) -> Reduced:
        """Return the equations without the information of cells (R − 1, C − 1) not chosen."""
        own = self.cells
        cells = replace(
            own, normal=own.normal * chosen, right=own.right * chosen, coupled=own.coupled * chosen
        )
        return replace(self, cells=cells)


def reduce_albedo(
    sums: Sums, albedo: FloatArray, before: FloatArray, known: FloatArray, sigma: float
) -> Reduced:
    """Eliminate the albedo of each cell, and add the priors of albedo and shifts.

    Parameters
    ----------
    sums : Sums
    albedo : (R − 1, C − 1) ndarray
    before : (K, 5) ndarray
        Nuisance parameters of the images; the first has no prior.
    known : (K, 5, 5) ndarray
        Prior information on these about 0.
    sigma : float
        Prior standard deviation of the albedo about 1.
    """
    count = len(before)
    alone = eliminate_albedo(sums, albedo, sigma)
    by_albedo = sums.normal[_WITH_ALBEDO, ...] / alone.weight
    normal = np.stack(
        [
            sums.normal[place] - by_albedo[a] * by_albedo[b] * alone.weight
            for place, (a, b) in zip(_OWN, _PAIRS, strict=True)
        ]
    )
    right = sums.right[:3] - by_albedo * alone.weight * alone.step
    coupled = np.empty((count, NUISANCES, 3, albedo.size))
    _eliminate(sums.coupled.reshape(count, 4, NUISANCES, -1), by_albedo.reshape(3, -1), coupled)
    own = alone.nuisance, alone.nuisance_right
    nuisance, nuisance_right = with_priors(own, before, known)
    coupled = coupled.reshape(NUISANCES * count, 3, *albedo.shape)
    cells = CellInformation(normal, right, coupled, nuisance, nuisance_right)
    return Reduced(cells, by_albedo, alone.step, alone.by_nuisance, alone.weight)


@compiled
def _eliminate(products: FloatArray, by_albedo: FloatArray, coupled: FloatArray) -> None:
    """Fill `coupled` (K, 5, 3, N): products of N cells with nuisances, without their albedo.

    `products` (K, 4, 5, N) are those of the slopes, the height and the albedo.
    """
    for k in range(coupled.shape[0]):
        for b in range(coupled.shape[1]):
            albedo = products[k, 3, b]
            for a in range(3):
                own, out, by = products[k, a, b], coupled[k, b, a], by_albedo[a]
                for j in range(out.size):
                    out[j] = own[j] - albedo[j] * by[j]


@dataclass(frozen=True, eq=False)
class Priors:
    """What is known of a surface apart from its images.

    Parameters
    ----------
    slopes : (2, R − 1, C − 1) ndarray
        Of the start surface.
    height, weight : (R, C) ndarrays
        Constraining heights, metres, and their weights, 1/m².
    """

    slopes: FloatArray
    height: FloatArray
    weight: FloatArray


def height_equations(
    reduced: Reduced,
    surface: Surface,
    priors: Priors,
    options: PhotoclinometryOptions,
    *,
    most_m: float = np.inf,
) -> CellSurface:
    """Return the normal equations of the changes of heights [22, 23].

    `most_m` is the standard deviation of the change of the mean height, metres: flat ground without
    constraints has no brightness gradient that would determine it, and it would go anywhere.
    """
    cells, height, gsd = reduced.cells, surface.height, surface.gsd
    weight = options.slope_sigma**-2
    normal, right = cells.normal.copy(), cells.right.copy()
    normal[0] += weight
    normal[3] += weight
    right[:2] += weight * (priors.slopes - surface.slopes)
    twist = np.full(surface.albedo.shape, (options.twist_sigma * gsd) ** -2)
    pull = priors.weight * (priors.height - height)
    _add_twist(pull, -twist * _twist(height))
    return CellSurface(
        CellInformation(normal, right, cells.coupled, cells.nuisance, cells.nuisance_right),
        gsd,
        priors.weight + most_m**-2 / height.size,
        pull,
        twist,
    )


def _twist(height: FloatArray) -> FloatArray:
    """Return h00 − h01 − h10 + h11 (R − 1, C − 1) of each cell."""
    return np.diff(np.diff(height, axis=0), axis=1)


def _add_twist(points: FloatArray, cells: FloatArray) -> None:
    """Add values of cells to their points (R, C), with the signs of :func:`_twist`."""
    points[:-1, :-1] += cells
    points[1:, 1:] += cells
    points[:-1, 1:] -= cells
    points[1:, :-1] -= cells


def changed_albedo(
    reduced: Reduced,
    surface: Surface,
    rise: FloatArray,
    nuisance: FloatArray,
    convention: AlbedoConvention,
) -> FloatArray:
    """Return the albedo (R − 1, C − 1) after changes of heights (R, C) and nuisances (P,)."""
    slopes, mean = cell_slopes(rise, surface.gsd), at_cells(rise)
    changes = np.stack([*slopes, mean])
    step = reduced.albedo - np.sum(reduced.by_albedo * changes, axis=0)
    step = step - np.tensordot(nuisance, reduced.albedo_by_nuisance, 1)
    return convention.bounded(surface.albedo + step)


def image_slopes(reduced: Reduced, most: float) -> tuple[FloatArray, AnyArray]:
    """Return sigmas (2, R − 1, C − 1) of slopes by images alone, and determined directions.

    A direction is determined if the sigma of the slope along it is at most `most`.
    """
    xx, xy, yy = reduced.cells.normal[[0, 1, 3]]
    middle, apart = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    least = most**-2
    directions = (middle + apart >= least).astype(np.int8) + (middle - apart >= least)
    with np.errstate(divide="ignore", invalid="ignore"):
        variance = np.stack([yy, xx]) / (xx * yy - xy * xy)
    one = np.stack([xx, yy]) > 0.0
    sigma = np.sqrt(np.where(one & (directions == 2), variance, np.inf))
    return sigma, directions
