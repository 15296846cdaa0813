"""Normal equations of a transform that takes one gridded surface to another.

Where two surfaces lie on one grid, their difference says how the moving one is displaced along
its normal. What it says of the parameters is weighed by slopes; slopes are noisy too, and noise
taken for relief makes the terrain hold the transform better than it does. The mean of both
surfaces' slopes is therefore the instrument, and the product of one's with the other's, whose
noises have nothing in common, is what the instrument tells (errors in variables).
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

# Below this share of what slopes show that is relief of both surfaces, and not noise of one, a
# parameter hangs on noise.
_LEAST_COMMON = 0.1
# Clusters for each parameter; their sides in lengths over which errors hold together.
_ENOUGH, _WIDE, _NARROW = 3.0, 8.0, 2.0


@dataclass(frozen=True, eq=False)
class SurfacePair:
    """Two surfaces on one grid, to be made to agree.

    Parameters
    ----------
    fixed, moving : (N, N) ndarrays
        Heights along the grid's Uz, metres; NaN where unknown.
    weight : (N, N) ndarray
        Of their difference, by its variance; 0 or NaN where it does not count.
    robust : (N, N) ndarray
        Huber's weights: below 1 the loss is linear, and the difference tells a direction only.
    """

    fixed: FloatArray
    moving: FloatArray
    weight: FloatArray
    robust: FloatArray

    @property
    def weights(self) -> FloatArray:
        """Weights (2, N, N) of the difference, and of its change when the surface moves.

        The second is Huber's ψ′: with the first in its place a transform seems better held than
        it is, by a sixth of its sigma.
        """
        full = self.weight * self.robust
        return np.stack([full, np.where(self.robust < 1.0, 0.0, full)])


@dataclass(frozen=True, eq=False)
class Equations:
    """What one or many pairs of surfaces say about P parameters.

    Attributes
    ----------
    normal : (P, P) ndarray
        Instrument times what it tells: M of ``M p = right``.
    shown : (P, P) ndarray
        Instrument times instrument, noise of the slopes included.
    right : (P,) ndarray
    scores : (K, P) ndarray
        The parts of `right` by cluster: errors within a cluster may hold together.
    cells : (K,) ndarray
        Grid points in each cluster.
    """

    normal: FloatArray
    shown: FloatArray
    right: FloatArray
    scores: FloatArray
    cells: FloatArray

    @classmethod
    def joined(cls, parts: list[Equations]) -> Equations:
        """Add up parts; each keeps its clusters."""
        return cls(
            np.sum([part.normal for part in parts], axis=0),
            np.sum([part.shown for part in parts], axis=0),
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
            A natural size of each.

        Raises
        ------
        NotObservableError
            If the relief leaves a parameter free, or shows no more of it than noise does.
        """
        scale = np.outer(natural, natural)
        check_rank(self.shown * scale, names)
        # Both in units in which all that is shown is 1.
        root = np.linalg.cholesky(self.shown * scale)
        half = np.linalg.solve(root, self.normal * scale)
        values, vectors = np.linalg.eigh(np.linalg.solve(root, half.T))
        weak = values < _LEAST_COMMON
        if weak.any():
            part = np.abs(np.linalg.solve(root.T, vectors[:, weak])).max(axis=1)
            free = tuple(
                name for name, size in zip(names, part / part.max(), strict=True) if size > 0.1
            )
            raise NotObservableError(
                f"the relief that both surfaces show leaves {', '.join(free)} free",
                free,
                do="take more ground, or estimate fewer parameters",
            )
        step: FloatArray = natural * np.linalg.solve(self.normal * scale, self.right * natural)
        return step

    def covariance(self, inside: float = 1.0) -> FloatArray:
        """Covariance (P, P) of the solution: ``M⁻¹ (Σ_k s_k s_kᵀ) M⁻ᵀ`` over clusters k.

        Whatever errors do within a cluster is counted; `inside` is the share of their correlation
        that lies within clusters and not across their borders. Of K clusters' scores the solution
        has taken P freedoms, put back by K/(K − P). Infinite where K does not exceed P. Source:
        Huber (1967); Liang & Zeger (1986); docs: derivations §20.
        """
        size, held = self.right.size, self.scores[self.cells > 0]
        if len(held) <= size:
            return np.full((size, size), np.inf)
        # At the solution the scores add up to nothing but for what is left of the last step.
        rest = held - held.sum(axis=0) * (self.cells[self.cells > 0] / self.cells.sum())[:, None]
        middle = rest.T @ rest * (len(held) / (len(held) - size) / inside)
        inverse = np.linalg.inv(self.normal)
        spread: FloatArray = inverse @ middle @ inverse.T
        return spread


@dataclass(frozen=True)
class Clusters:
    """Squares of grid points into which a surface is cut.

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
        """Return the squares for errors that hold together over `area` cells.

        Eight lengths √area wide, if a surface of `points` a side falls into three times as many as
        there are parameters; else narrower, but not below two lengths. Of errors that
        hold together as a Gaussian does a share √area / (π block) reaches across, on each axis.
        """
        length = max(float(np.sqrt(area)), 1.0)
        most = points / np.ceil(np.sqrt(_ENOUGH * parameters))
        block = max(int(min(_WIDE * length, most)), int(np.ceil(_NARROW * length)))
        return cls(block, (1.0 - length / (np.pi * block)) ** 2)


def modelled_covariance(
    parts: Sequence[Equations], areas: Sequence[float], shift_sigma_m: float
) -> FloatArray:
    """Covariance (P, P) of the solution from a few surfaces, whose errors are known from others.

    Of few clusters the scores do not tell their own spread. Differences of standard deviation 1
    that hold together over an area of cells give a surface's scores the covariance ``area Σ g gᵀ``;
    a surface that is displaced as a whole by `shift_sigma_m`, each axis, adds the square of what
    its equations feel of a translation.

    Parameters
    ----------
    parts : sequence of Equations
        One for each surface; translations first, weights in units of the differences' variance.
    areas : sequence of float
        Cells over which differences hold together.
    shift_sigma_m : float
        Metres.
    """
    inverse = np.linalg.inv(np.sum([part.normal for part in parts], axis=0))
    middle = np.sum(
        [
            area * part.shown + shift_sigma_m**2 * part.normal[:, :3] @ part.normal[:, :3].T
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
) -> Equations:
    """Return what a pair says about a transform of the moving surface.

    Parameters
    ----------
    pair : SurfacePair
        The moving one as `transform` has placed it.
    grid : MapletGrid
        Of both; body-fixed.
    transform : Affine
        Where the partials are taken (:func:`fusion.registration.fit.transform_partials`).
    about : (3,) ndarray
        The point of the moving frame about which rotation, scale and matrix act, metres.
    size : {6, 7, 12}
        Number of parameters: rigid, similarity, affine.
    block : int
        Grid points along a side of the square clusters.

    Returns
    -------
    Equations
    """
    slopes = both_slopes(pair, grid.gsd)
    known = np.isfinite(pair.fixed - pair.moving + slopes.sum(axis=0))
    weights = np.where(known, np.nan_to_num(pair.weights), 0.0)
    scale = 1.0 / transform.nearest_similarity().scale if size == 7 else 1.0
    normal, shown, scores, cells = _accumulate(
        np.concatenate([[pair.fixed, pair.moving], weights]),
        slopes,
        np.concatenate([grid.axes, [grid.center - transform.apply(about)]]),
        # The arm of a matrix is that of the moving frame.
        np.linalg.inv(transform.matrix) if size == 12 else np.eye(3),
        (grid.gsd, scale),
        size,
        block,
    )
    return Equations(normal.sum(axis=0), shown.sum(axis=0), scores.sum(axis=0), scores, cells)


def both_slopes(pair: SurfacePair, gsd: float) -> FloatArray:
    """Slopes (4, N, N): along x and y of the fixed surface, then of the moving one.

    Beside a gap of one surface the other's slopes serve for both.
    """
    fixed_y, fixed_x = np.gradient(pair.fixed, gsd)
    moving_y, moving_x = np.gradient(pair.moving, gsd)
    fixed = np.stack([fixed_x, fixed_y])
    moving = np.stack([moving_x, moving_y])
    known, other = np.isfinite(fixed).all(axis=0), np.isfinite(moving).all(axis=0)
    return np.concatenate([np.where(known, fixed, moving), np.where(other, moving, fixed)])


@compiled
def _fill_row(row: FloatArray, normal: FloatArray, arm: FloatArray, per_scale: float) -> None:
    """Partials of the height of the moving surface by 6, 7 or 12 parameters.

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
    """Sum up the cells by rows of blocks.

    `layers` are fixed, moving and the two weights; `frame` the grid's axes and its centre from the
    image of the point about which the parameters act; `steps` GSD and one over the scale.
    """
    points = layers.shape[1]
    blocks = (points + block - 1) // block
    normal, shown = np.zeros((blocks, size, size)), np.zeros((blocks, size, size))
    scores, cells = np.zeros((blocks, blocks, size)), np.zeros((blocks, blocks))
    middle = 0.5 * (points - 1)
    for band in range(blocks):
        first, second, mean = np.empty(size), np.empty(size), np.empty(size)
        up, arm, place = np.empty(3), np.empty(3), np.empty(3)
        for row in range(band * block, min((band + 1) * block, points)):
            for column in range(points):
                weight, firm = layers[2, row, column], layers[3, row, column]
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
                        normal[band, p, q] += firm * cross
                        shown[band, p, q] += firm * mean[p] * mean[q]
        for p in range(size):
            for q in range(p):
                normal[band, q, p] = normal[band, p, q]
                shown[band, q, p] = shown[band, p, q]
    return normal, shown, scores.reshape(-1, size), cells.ravel()
