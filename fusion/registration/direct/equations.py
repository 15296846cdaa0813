"""Normal equations of a transform that takes one gridded surface to another.

The difference of two surfaces on one grid observes the displacement of the moving one along its
normal. Its partials are slopes, which are noisy: noise counted as relief would make the normal
matrix too large and sigmas too small. The mean of both surfaces' slopes is therefore the
instrumental variable, and the normal matrix is the product of one surface's slopes with the
other's, whose noises are independent (errors in variables).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fusion.estimation import check_rank
from spcola.arrays import FloatArray
from spcola.compilation import compiled
from spcola.errors import NotObservableError
from spcola.grids import MapletGrid
from spcola.math import Affine

# Smallest share of common relief in the squared slopes; below it noise dominates a parameter.
_LEAST_COMMON = 0.1
# Clusters for each parameter; largest and smallest side in correlation lengths.
_ENOUGH, _WIDE, _NARROW = 3.0, 8.0, 2.0


@dataclass(frozen=True, eq=False)
class SurfacePair:
    """Two surfaces on one grid, with weights.

    Parameters
    ----------
    fixed, moving : (N, N) ndarrays
        Heights along the grid's Uz, metres; NaN where unknown.
    weight : (N, N) ndarray
        Inverse variance of their difference, 1/m²; 0 or NaN where it is not used.
    robust : (N, N) ndarray
        Huber's weights: below 1 the loss is linear.
    """

    fixed: FloatArray
    moving: FloatArray
    weight: FloatArray
    robust: FloatArray

    @property
    def weights(self) -> FloatArray:
        """Weights (2, N, N) of the difference, and of its derivative.

        The second is Huber's ψ′: with the first in its place sigmas would be too small by a sixth.
        """
        full = self.weight * self.robust
        return np.stack([full, np.where(self.robust < 1.0, 0.0, full)])


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal equations of P parameters from one or many pairs of surfaces.

    Attributes
    ----------
    normal : (P, P) ndarray
        M of ``M p = right``: products of one surface's partials with the other's.
    noisy : (P, P) ndarray
        Products of the mean partials with themselves, noise of the slopes included.
    right : (P,) ndarray
    scores : (K, P) ndarray
        The parts of `right` by cluster: errors within a cluster may be correlated.
    cells : (K,) ndarray
        Grid points in each cluster.
    """

    normal: FloatArray
    noisy: FloatArray
    right: FloatArray
    scores: FloatArray
    cells: FloatArray

    @classmethod
    def joined(cls, parts: list[NormalEquations]) -> NormalEquations:
        """Sum parts; their clusters remain separate."""
        return cls(
            np.sum([part.normal for part in parts], axis=0),
            np.sum([part.noisy for part in parts], axis=0),
            np.sum([part.right for part in parts], axis=0),
            np.concatenate([part.scores for part in parts]),
            np.concatenate([part.cells for part in parts]),
        )

    def solve(self, names: tuple[str, ...], natural: FloatArray) -> FloatArray:
        """Return the step (P,).

        Parameters
        ----------
        names : tuple of str
            Of the parameters.
        natural : (P,) ndarray
            Typical size of each.

        Raises
        ------
        NotObservableError
            If the relief common to both surfaces does not determine a parameter.
        """
        scale = np.outer(natural, natural)
        check_rank(self.noisy * scale, names)
        # Eigenvalues of `normal` relative to `noisy`.
        root = np.linalg.cholesky(self.noisy * scale)
        half = np.linalg.solve(root, self.normal * scale)
        values, vectors = np.linalg.eigh(np.linalg.solve(root, half.T))
        weak = values < _LEAST_COMMON
        if weak.any():
            part = np.abs(np.linalg.solve(root.T, vectors[:, weak])).max(axis=1)
            free = tuple(
                name for name, size in zip(names, part / part.max(), strict=True) if size > 0.1
            )
            raise NotObservableError(
                f"the relief common to both surfaces does not determine {', '.join(free)}",
                free,
                do="use more ground, or estimate fewer parameters",
            )
        step: FloatArray = natural * np.linalg.solve(self.normal * scale, self.right * natural)
        return step

    def covariance(self, inside: float = 1.0) -> FloatArray:
        """Covariance (P, P) of the solution: ``M⁻¹ (Σ_k s_k s_kᵀ) M⁻ᵀ`` over clusters k.

        It allows for any correlation of errors within a cluster; `inside` is the share of the
        correlation within clusters rather than across their borders. The factor K/(K − P) accounts
        for the degrees of freedom that the solution takes. Infinite if K does not exceed P. Source:
        Huber (1967); Liang & Zeger (1986); docs: derivations §20.
        """
        size, scores = self.right.size, self.scores[self.cells > 0]
        if len(scores) <= size:
            return np.full((size, size), np.inf)
        # At the solution the scores sum to 0 except for the remainder of the last step.
        share = (self.cells[self.cells > 0] / self.cells.sum())[:, None]
        rest = scores - scores.sum(axis=0) * share
        middle = rest.T @ rest * (len(scores) / (len(scores) - size) / inside)
        inverse = np.linalg.inv(self.normal)
        spread: FloatArray = inverse @ middle @ inverse.T
        return spread


@dataclass(frozen=True)
class Clusters:
    """Squares of grid points into which a surface is divided.

    Parameters
    ----------
    block : int
        Points along a side.
    inside : float
        Share of the correlation of errors that lies within squares.
    """

    block: int
    inside: float = 1.0

    @classmethod
    def of(cls, area: float, points: int, parameters: int) -> Clusters:
        """Return squares for errors with a correlation area of `area` cells.

        They are eight correlation lengths √area wide if a surface of `points` a side then has three
        times as many squares as there are parameters; else narrower, but at least two lengths. For
        a Gaussian correlation a share √area / (π block) crosses the borders, on each axis.
        """
        length = max(float(np.sqrt(area)), 1.0)
        most = points / np.ceil(np.sqrt(_ENOUGH * parameters))
        block = max(int(min(_WIDE * length, most)), int(np.ceil(_NARROW * length)))
        return cls(block, (1.0 - length / (np.pi * block)) ** 2)


def modelled_covariance(
    parts: Sequence[NormalEquations], areas: Sequence[float], shift_sigma_m: float
) -> FloatArray:
    """Covariance (P, P) of the solution from a few surfaces with known error statistics.

    The scores of few clusters do not determine their own spread. Differences of standard deviation
    1 with a correlation area give a surface's scores the covariance ``area Σ g gᵀ``. A displacement
    of the whole surface by `shift_sigma_m`, each axis, adds ``shift_sigma_m² N Nᵀ``, N being the
    columns of its normal matrix for translations.

    Parameters
    ----------
    parts : sequence of NormalEquations
        One for each surface; translations first, weights relative to the differences' variance.
    areas : sequence of float
        Correlation areas of the differences, cells.
    shift_sigma_m : float
        Metres.
    """
    inverse = np.linalg.inv(np.sum([part.normal for part in parts], axis=0))
    middle = np.sum(
        [
            area * part.noisy + shift_sigma_m**2 * part.normal[:, :3] @ part.normal[:, :3].T
            for part, area in zip(parts, areas, strict=True)
        ],
        axis=0,
    )
    spread: FloatArray = inverse @ middle @ inverse.T
    return spread


def pair_equations(
    pair: SurfacePair,
    grid: MapletGrid,
    transform: Affine,
    about: FloatArray,
    *,
    size: int,
    block: int,
) -> NormalEquations:
    """Return the normal equations of a transform of the moving surface from a pair.

    Parameters
    ----------
    pair : SurfacePair
        The moving surface after `transform`.
    grid : MapletGrid
        Of both; body-fixed.
    transform : Affine
        Transform at which the partials are evaluated
        (:func:`fusion.registration.transform.transform_partials`).
    about : (3,) ndarray
        The point of the moving frame about which rotation, scale and matrix act, metres.
    size : {6, 7, 12}
        Number of parameters: rigid, similarity, affine.
    block : int
        Grid points along a side of the square clusters.

    Returns
    -------
    NormalEquations
    """
    slopes = both_slopes(pair, grid.gsd)
    known = np.isfinite(pair.fixed - pair.moving + slopes.sum(axis=0))
    weights = np.where(known, np.nan_to_num(pair.weights), 0.0)
    scale = 1.0 / transform.nearest_similarity().scale if size == 7 else 1.0
    normal, noisy, scores, cells = _accumulate(
        np.concatenate([[pair.fixed, pair.moving], weights]),
        slopes,
        np.concatenate([grid.axes, [grid.center - transform.apply(about)]]),
        # The arm of a matrix is that of the moving frame.
        np.linalg.inv(transform.matrix) if size == 12 else np.eye(3),
        (grid.gsd, scale),
        size,
        block,
    )
    return NormalEquations(normal.sum(axis=0), noisy.sum(axis=0), scores.sum(axis=0), scores, cells)


def both_slopes(pair: SurfacePair, gsd: float) -> FloatArray:
    """Slopes (4, N, N): along x and y of the fixed surface, then of the moving one.

    Where one is not known, next to a gap, the other surface's slopes are used for both.
    """
    fixed_y, fixed_x = np.gradient(pair.fixed, gsd)
    moving_y, moving_x = np.gradient(pair.moving, gsd)
    fixed = np.stack([fixed_x, fixed_y])
    moving = np.stack([moving_x, moving_y])
    known, other = np.isfinite(fixed).all(axis=0), np.isfinite(moving).all(axis=0)
    return np.concatenate([np.where(known, fixed, moving), np.where(other, moving, fixed)])


@compiled
def _fill_row(row: FloatArray, normal: FloatArray, arm: FloatArray, per_scale: float) -> None:
    """Partials of the height of the moving surface with respect to 6, 7 or 12 parameters.

    ``normal`` is (−∂h/∂x, −∂h/∂y, 1) in body axes: a point displaced by δ raises the surface by
    ``normal · δ``.
    """
    size = len(row)
    for i in range(3):
        row[i] = normal[i]
    if size == 12:
        for i in range(3):
            for j in range(3):
                row[3 + 3 * i + j] = normal[i] * arm[j]
        return
    row[3] = arm[1] * normal[2] - arm[2] * normal[1]
    row[4] = arm[2] * normal[0] - arm[0] * normal[2]
    row[5] = arm[0] * normal[1] - arm[1] * normal[0]
    if size == 7:
        row[6] = per_scale * (arm[0] * normal[0] + arm[1] * normal[1] + arm[2] * normal[2])


@compiled
def _accumulate(
    layers: FloatArray,
    slopes: FloatArray,
    frame: FloatArray,
    back: FloatArray,
    steps: tuple[float, float],
    size: int,
    block: int,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Sum over the cells by rows of blocks.

    `layers` are fixed, moving and the two weights; `frame` the grid's axes, and its centre relative
    to the image of the point about which the parameters act; `steps` GSD and inverse scale.
    """
    points = layers.shape[1]
    blocks = (points + block - 1) // block
    normal, noisy = np.zeros((blocks, size, size)), np.zeros((blocks, size, size))
    scores, cells = np.zeros((blocks, blocks, size)), np.zeros((blocks, blocks))
    middle = 0.5 * (points - 1)
    for band in range(blocks):
        first, second, mean = np.empty(size), np.empty(size), np.empty(size)
        up, arm, place = np.empty(3), np.empty(3), np.empty(3)
        for row in range(band * block, min((band + 1) * block, points)):
            for column in range(points):
                weight, curvature = layers[2, row, column], layers[3, row, column]
                if weight <= 0.0:
                    continue
                height = 0.5 * (layers[0, row, column] + layers[1, row, column])
                x, y = (column - middle) * steps[0], (row - middle) * steps[0]
                for i in range(3):
                    place[i] = x * frame[0, i] + y * frame[1, i] + height * frame[2, i]
                    place[i] += frame[3, i]
                for i in range(3):
                    arm[i] = back[i, 0] * place[0] + back[i, 1] * place[1] + back[i, 2] * place[2]
                for side in range(2):
                    slope_x, slope_y = (
                        slopes[2 * side, row, column],
                        slopes[2 * side + 1, row, column],
                    )
                    for i in range(3):
                        up[i] = frame[2, i] - slope_x * frame[0, i] - slope_y * frame[1, i]
                    _fill_row(first if side == 0 else second, up, arm, steps[1])
                difference = layers[0, row, column] - layers[1, row, column]
                cluster = column // block
                cells[band, cluster] += 1.0
                for p in range(size):
                    mean[p] = 0.5 * (first[p] + second[p])
                    scores[band, cluster, p] += weight * mean[p] * difference
                    for q in range(p + 1):
                        cross = 0.5 * (first[p] * second[q] + second[p] * first[q])
                        normal[band, p, q] += curvature * cross
                        noisy[band, p, q] += curvature * mean[p] * mean[q]
        for p in range(size):
            for q in range(p):
                normal[band, q, p] = normal[band, p, q]
                noisy[band, q, p] = noisy[band, p, q]
    return normal, noisy, scores.reshape(-1, size), cells.ravel()
