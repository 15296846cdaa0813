"""Normal equations of the albedo of cells [21], eliminated from those of the images."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from spcola.arrays import AnyArray, FloatArray
from spcola.compilation import compiled
from spcola.photometry.photoclinometry.albedo_prior import ExpectedAlbedo
from spcola.photometry.photoclinometry.cell_pixels import NUISANCES, UNKNOWNS, cell_offset
from spcola.photometry.photoclinometry.image_equations import Sums

# Where products of the albedo with itself and with both slopes, and those of the slopes, lie in the
# upper triangle of a cell.
_ALBEDO, _WITH_SLOPES, _SLOPES = 9, (3, 6), (0, 1, 4)


@dataclass(frozen=True, eq=False)
class AlbedoEquations:
    """The albedo of cells, and the images' nuisance parameters without it.

    Attributes
    ----------
    weight : (R − 1, C − 1) ndarray
        Information on the albedo, prior included.
    step : (R − 1, C − 1) ndarray
        Change of the albedo where nothing else changes.
    rows : (P, R − 1, C − 1) ndarray
        Products of the albedo with each of the P nuisance parameters, over the root of `weight`.
    own, own_right : (K, M, M), (K, M) ndarrays
        Normal matrices and right-hand sides of the M nuisance parameters of each of K images, the
        albedo as it is.
    """

    weight: FloatArray
    step: FloatArray
    rows: FloatArray
    own: FloatArray
    own_right: FloatArray

    @cached_property
    def nuisance(self) -> FloatArray:
        """Normal matrix (P, P) of all nuisance parameters, without priors."""
        flat, count = self._flat_rows, self.own.shape[1]
        # A matrix times its own transpose costs half of a product of two matrices.
        normal = -(flat @ flat.T)
        for k, own in enumerate(self.own):
            place = slice(count * k, count * (k + 1))
            normal[place, place] += own
        return normal

    @property
    def nuisance_right(self) -> FloatArray:
        """Right-hand side (P,) of these."""
        pull = np.sqrt(self.weight) * self.step
        return self.own_right.ravel() - self._flat_rows @ pull.ravel()

    @property
    def _flat_rows(self) -> FloatArray:
        return self.rows.reshape(len(self.rows), self.weight.size)

    @property
    def by_nuisance(self) -> FloatArray:
        """How much the albedo falls (P, R − 1, C − 1) with each of the nuisance parameters."""
        return self.rows / np.sqrt(self.weight)

    def fall(self, nuisance: FloatArray) -> FloatArray:
        """Return how much the albedo (R − 1, C − 1) falls with nuisance parameters (P,)."""
        return np.tensordot(nuisance, self.rows, 1) / np.sqrt(self.weight)

    def with_parameters(self, change: FloatArray) -> AlbedoEquations:
        """Return the equations for other nuisance parameters, changed alike in each image.

        `change` (5, 5) takes derivatives by the present parameters of an image to those by the
        other ones.
        """
        count = len(self.rows) // NUISANCES
        rows = np.tensordot(change, self.rows.reshape(count, NUISANCES, -1), (1, 1))
        return replace(
            self,
            rows=np.moveaxis(rows, 0, 1).reshape(self.rows.shape),
            own=change @ self.own @ change.T,
            own_right=self.own_right @ change.T,
        )


def eliminate_albedo(
    sums: Sums, expected: ExpectedAlbedo, *, parameters: int = NUISANCES
) -> AlbedoEquations:
    """Return the equations of albedo and nuisance parameters, slopes and heights as they are.

    Parameters
    ----------
    sums : Sums
        Over K images.
    expected : ExpectedAlbedo
        Prior of the albedo.
    parameters : int
        Nuisance parameters of each image: 5, or 6 with that of its contrast.
    """
    count = len(sums.nuisance)
    weight = sums.normal[_ALBEDO] + expected.information
    step = (sums.right[3] + expected.right) / weight
    root = np.sqrt(weight)
    rows = np.empty((parameters * count, *weight.shape))
    _albedo_rows(sums.factors, root, rows)
    own = sums.nuisance[:, :parameters]
    return AlbedoEquations(weight, step, rows, own[..., :parameters], own[..., -1])


def albedo_information(sums: Sums, slope_sigma: float) -> FloatArray:
    """Return the information (R − 1, C − 1) of images on the albedo of cells, slopes unknown.

    `slope_sigma` is the prior standard deviation of these.
    """
    weight = slope_sigma**-2
    xx, xy, yy = sums.normal[_SLOPES, ...]
    x, y = sums.normal[_WITH_SLOPES, ...]
    xx, yy = xx + weight, yy + weight
    by_slopes = (yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy)
    return np.maximum(sums.normal[_ALBEDO] - by_slopes, 0.0)


@compiled
def _albedo_rows(factors: AnyArray, root: FloatArray, rows: FloatArray) -> None:
    """Fill `rows` (P, R − 1, C − 1) from factors of K images, see :class:`AlbedoEquations`."""
    parameters = rows.shape[0] // max(factors.shape[0], 1)
    for k in range(factors.shape[0]):
        own, into = factors[k], rows[parameters * k : parameters * (k + 1)]
        for i in range(root.shape[0]):
            along_y = cell_offset(i, root.shape[0])
            for j in range(root.shape[1]):
                by_albedo = own[UNKNOWNS - 1, i, j] / root[i, j]
                bright = by_albedo * own[UNKNOWNS, i, j]
                into[0, i, j] = bright
                into[1, i, j] = bright * cell_offset(j, root.shape[1])
                into[2, i, j] = bright * along_y
                for a in range(3, parameters):
                    into[a, i, j] = by_albedo * own[UNKNOWNS + a - 2, i, j]


def with_priors(
    equations: tuple[FloatArray, FloatArray], before: FloatArray, known: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return matrix (P, P) and right-hand side (P,) of nuisance parameters with their priors.

    Parameters
    ----------
    equations : (P, P), (P,) ndarrays
        Without priors.
    before : (K, M) ndarray
        Nuisance parameters of the images; the first has no prior.
    known : (K, M, M) ndarray
        Prior information on these about 0.
    """
    normal, right = (one.copy() for one in equations)
    count = before.shape[1]
    for k in range(len(before)):
        own = slice(count * k, count * (k + 1))
        normal[own, own] += known[k]
        right[own] -= known[k] @ before[k]
    return normal, right
