"""From the sums over images to heights and albedo: albedo eliminated, priors, integration."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from spcola.arrays import AnyArray, BoolArray, FloatArray
from spcola.compilation import compiled
from spcola.photometry.ground import at_cells
from spcola.photometry.photoclinometry.albedo_convention import AlbedoConvention
from spcola.photometry.photoclinometry.albedo_equations import (
    AlbedoEquations,
    eliminate_albedo,
    with_priors,
)
from spcola.photometry.photoclinometry.albedo_prior import ExpectedAlbedo
from spcola.photometry.photoclinometry.cell_pixels import UNKNOWNS, WITH_CONTRAST, cell_offset
from spcola.photometry.photoclinometry.cell_surface import TOLERANCE, CellInformation, CellSurface
from spcola.photometry.photoclinometry.constraints import GridHeights
from spcola.photometry.photoclinometry.image_equations import Sums
from spcola.photometry.photoclinometry.options import PhotoclinometryOptions
from spcola.photometry.photoclinometry.point_heights import PointEquations
from spcola.photometry.photoclinometry.posterior import Posterior
from spcola.photometry.photoclinometry.surface import Surface, cell_slopes

# Where the six products of (∂h/∂x, ∂h/∂y, h) lie in the upper triangle with the albedo, and where
# their products with the albedo do.
_OWN, _WITH_ALBEDO = (0, 1, 2, 4, 5, 7), (3, 6, 8)
_PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
# Standard deviation of the twist of cells of rough ground, of a GSD.
_GROUND_TWIST = 0.12


@dataclass(frozen=True, eq=False)
class Reduced:
    """Normal equations of all cells without their albedo.

    Attributes
    ----------
    normal, right : (6, R − 1, C − 1), (3, R − 1, C − 1) ndarrays
        Upper triangles and right-hand sides of (∂h/∂x, ∂h/∂y, h), of images alone.
    by_albedo : (3, R − 1, C − 1) ndarray
        Products of (∂h/∂x, ∂h/∂y, h) with the albedo, over the albedo's information: how much the
        albedo changes with them.
    albedo : AlbedoEquations
        Prior included.
    factors : (K, 8, R − 1, C − 1) ndarray
        As of :class:`Sums`.
    before : (K, M) ndarray
        Nuisance parameters of the images, 5 or 6 with that of the contrast; the first has no prior.
    known : (K, M, M) ndarray
        Prior information on these about 0.
    gsd : float
        Metres.
    """

    normal: FloatArray
    right: FloatArray
    by_albedo: FloatArray
    albedo: AlbedoEquations
    factors: AnyArray
    before: FloatArray
    known: FloatArray
    gsd: float

    @property
    def slopes(self) -> FloatArray:
        """Information (3, R − 1, C − 1) of images alone on slopes of cells: xx, xy, yy."""
        return self.normal[[0, 1, 3]]

    @cached_property
    def cells(self) -> CellInformation:
        """What images alone determine, with the priors of nuisance parameters."""
        own = self.albedo.nuisance, self.albedo.nuisance_right
        nuisance, nuisance_right = with_priors(own, self.before, self.known)
        _, rows, columns = self.right.shape
        coupled = np.zeros((len(nuisance), rows + 1, columns + 1), dtype=np.float32)
        _couple(self.factors, self.by_albedo, self.gsd, coupled)
        return CellInformation(self.normal, self.right, coupled, nuisance, nuisance_right)


def reduce_albedo(
    sums: Sums, surface: Surface, before: FloatArray, known: FloatArray, expected: ExpectedAlbedo
) -> Reduced:
    """Eliminate the albedo of each cell, and add the priors of albedo and shifts.

    Parameters
    ----------
    sums : Sums
        Over K images.
    surface : Surface
    before, known : (K, M), (K, M, M) ndarrays
        As of :class:`Reduced`.
    expected : ExpectedAlbedo
        Prior of the albedo.
    """
    alone = eliminate_albedo(sums, expected, parameters=before.shape[1])
    by_albedo = sums.normal[_WITH_ALBEDO, ...] / alone.weight
    normal = np.stack(
        [
            sums.normal[place] - by_albedo[a] * by_albedo[b] * alone.weight
            for place, (a, b) in zip(_OWN, _PAIRS, strict=True)
        ]
    )
    right = sums.right[:3] - by_albedo * alone.weight * alone.step
    return Reduced(normal, right, by_albedo, alone, sums.factors, before, known, surface.gsd)


@compiled
def _couple(factors: AnyArray, by_albedo: FloatArray, gsd: float, out: AnyArray) -> None:
    """Add to `out` (P, R, C) the products of heights with the nuisance parameters of K images.

    Those of the slopes and mean heights of the cells, without their albedo, are taken to their
    corners.
    """
    _, down, cells = by_albedo.shape
    count = out.shape[0] // max(factors.shape[0], 1)
    # One number on either side of those of the cells stays 0: points at the edge have one cell.
    corners, extra = np.zeros((4, cells + 2)), np.zeros((WITH_CONTRAST, cells + 2))
    for k in range(factors.shape[0]):
        own = factors[k]
        for i in range(down):
            _take_to_corners(own, by_albedo, (i, gsd), corners)
            along_y = cell_offset(i, down)
            for b in range(count):
                factor = UNKNOWNS + max(b - 2, 0)
                for j in range(cells):
                    extra[b, j + 1] = own[factor, i, j]
            for j in range(cells):
                extra[1, j + 1] *= cell_offset(j, cells)
                extra[2, j + 1] *= along_y
            for b in range(count):
                for corner in (0, 2):
                    place, row = count * k + b, i + corner // 2
                    for j in range(cells + 1):
                        out[place, row, j] += (
                            corners[corner, j + 1] * extra[b, j + 1]
                            + corners[corner + 1, j] * extra[b, j]
                        )


@compiled
def _take_to_corners(
    own: AnyArray, by_albedo: FloatArray, place: tuple[int, float], corners: FloatArray
) -> None:
    """Fill `corners` (4, C + 1): derivatives by the heights of the corners of a row of cells.

    `place` is the row, and the GSD.
    """
    i, gsd = place
    half = 0.5 / gsd
    for j in range(by_albedo.shape[2]):
        albedo = np.float64(own[UNKNOWNS - 1, i, j])
        x = half * (own[0, i, j] - by_albedo[0, i, j] * albedo)
        y = half * (own[1, i, j] - by_albedo[1, i, j] * albedo)
        h = 0.25 * (own[2, i, j] - by_albedo[2, i, j] * albedo)
        corners[0, j + 1], corners[1, j + 1] = h - x - y, h + x - y
        corners[2, j + 1], corners[3, j + 1] = h - x + y, h + x + y


@dataclass(frozen=True, eq=False)
class Priors:
    """What is known of a surface apart from its images.

    Parameters
    ----------
    slopes : (2, R − 1, C − 1) ndarray
        Of the start surface.
    slope_sigma : float or (R − 1, C − 1) ndarray
        Standard deviation of slopes about these.
    heights : tuple of GridHeights
        Constraining heights of the grid's points.
    points : PointEquations
        Constraining heights of points between those of the grid.
    """

    slopes: FloatArray
    slope_sigma: float | FloatArray
    heights: tuple[GridHeights, ...]
    points: PointEquations


class HeightEquations(CellSurface):
    """Equations whose nuisance parameters are followed by errors that constraining heights share.

    Parameters
    ----------
    cells : CellInformation
        Of images and priors.
    priors : Priors
        Shared errors of their heights are eliminated, and are not in the solution: each round finds
        them anew.
    surface : Surface
        About which heights are solved.
    weight, right : (R, C) ndarrays
        Further weights of heights of the grid's points, 1/m², and right-hand sides.
    twist : (R − 1, C − 1) ndarray
        As of :class:`CellSurface`.
    """

    def __init__(
        self,
        cells: CellInformation,
        priors: Priors,
        surface: Surface,
        weight: FloatArray,
        right: FloatArray,
        twist: FloatArray,
    ) -> None:
        self._own = len(cells.nuisance)
        points = priors.points
        by_points, pulled = points.about(surface)
        known, right = np.array(points.diagonals), right + by_points
        known[0] += weight
        coupled, information, pulls = [points.coupled], [points.shared], [pulled]
        for one in priors.heights:
            pull = one.weight * one.above(surface.height)
            known[0] += one.weight
            right = right + pull
            if one.shared_sigma:
                coupled.append(one.weight[None])
                information.append(np.array([[one.weight.sum() + one.shared_sigma**-2.0]]))
                pulls.append(np.array([pull.sum()]))
        shared = np.concatenate(pulls)
        with_heights = CellInformation(
            cells.normal,
            cells.right,
            np.concatenate([cells.coupled, *coupled]) if len(shared) else cells.coupled,
            block_diag(cells.nuisance, *information) if len(shared) else cells.nuisance,
            np.concatenate([cells.nuisance_right, shared]),
        )
        super().__init__(with_heights, surface.gsd, known, right, twist)

    def solve(self, *, tolerance: float = TOLERANCE) -> tuple[FloatArray, FloatArray]:
        """Return heights (R, C), metres, and nuisance parameters (P,), those of points left out."""
        heights, nuisance = super().solve(tolerance=tolerance)
        return heights, nuisance[: self._own]

    def posterior(self, considered: BoolArray | None = None, sigma: float = 0.0) -> Posterior:
        """Return covariances of heights; `considered` are nuisance parameters of the cells."""
        if considered is not None:
            shared = len(self._coupled) - self._own
            considered = np.concatenate([considered, np.zeros(shared, dtype=np.bool_)])
        return super().posterior(considered, sigma)


def height_equations(
    reduced: Reduced,
    surface: Surface,
    priors: Priors,
    options: PhotoclinometryOptions,
    *,
    most_m: float = np.inf,
) -> HeightEquations:
    """Return the normal equations of the changes of heights [22, 23].

    `most_m` is the standard deviation of the change of the mean height, metres: flat ground without
    constraints has no brightness gradient that would determine it, and it would go anywhere.
    """
    cells, height, gsd = reduced.cells, surface.height, surface.gsd
    away = priors.slopes - surface.slopes
    most = options.slope_loss_scale * options.slope_sigma
    weight = priors.slope_sigma**-2 / (1.0 + np.sum(away**2, axis=0) / most**2)
    normal, right = cells.normal.copy(), cells.right.copy()
    normal[0] += weight
    normal[3] += weight
    right[:2] += weight * away
    twist = _twist_information(priors.points, options.twist_sigma, gsd)
    pull = np.zeros(height.shape)
    _add_twist(pull, -twist * _twist(height))
    return HeightEquations(
        CellInformation(normal, right, cells.coupled, cells.nuisance, cells.nuisance_right),
        priors,
        surface,
        np.full(height.shape, most_m**-2 / height.size),
        pull,
        twist,
    )


def _twist_information(points: PointEquations, sigma: float, gsd: float) -> FloatArray:
    """Return the prior information (R − 1, C − 1), 1/m², on the twist of each cell.

    Points see little of it, and their noise would go into it: it is that of rough ground. Where
    there are none, errors of brightness are common to many cells: a tight prior turns them into
    errors of heights.
    """
    return (np.where(points.occupied, min(sigma, _GROUND_TWIST), sigma) * gsd) ** -2


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
    step = reduced.albedo.step - np.sum(reduced.by_albedo * changes, axis=0)
    step = step - reduced.albedo.fall(nuisance)
    return convention.bounded(surface.albedo + step)


def albedo_sigma_of(
    reduced: Reduced, heights: Posterior, options: PhotoclinometryOptions
) -> FloatArray:
    """Return the sigma (R − 1, C − 1) of the albedo, at most `albedo_sigma`.

    Errors of slopes, heights and nuisance parameters are in it, and relief within cells.
    """
    alone = reduced.albedo
    variance = 1.0 / alone.weight + options.relief_albedo_sigma**2
    variance = variance + heights.cells(reduced.by_albedo, alone.by_nuisance, reduced.gsd)
    return np.minimum(np.sqrt(variance), options.albedo_sigma)


def determined_directions(reduced: Reduced, most: float) -> AnyArray:
    """Return in how many directions images alone determine the slope of each cell (R − 1, C − 1).

    A direction is determined if the sigma of the slope along it is at most `most`.
    """
    xx, xy, yy = reduced.slopes
    middle, apart = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    least = most**-2
    return (middle + apart >= least).astype(np.int8) + (middle - apart >= least)
