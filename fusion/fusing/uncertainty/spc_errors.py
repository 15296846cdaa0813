"""Errors of SPC slopes and heights, estimated by comparison with the lidar."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from fusion.fusing.uncertainty.shape_errors import ShapeErrors, estimate_shape_errors
from fusion.fusing.uncertainty.variogram import correlated_cells, ends, walk_sigma
from spcola.arrays import FloatArray, IntArray
from spcola.grids.bending import bending
from spcola.math.robust import mad
from spcola.photometry import SlopeVariance

# Fewer differences than this do not give a spread.
_ENOUGH = 200
# Largest lag, cells, at which steps matter: over larger distances heights of the lidar or of the
# maplet itself dominate.
_STEP_REACH = 3
# Steps in a group; their median determines the variance to 12 %.
_GROUP = 100
# Largest number of steps used: enough for a thousand groups.
_MOST_STEPS = 100_000
# With fewer groups the dependence of step errors on slope, bending and light is not estimated.
_LEAST_GROUPS = 5
# Of the variogram, cells.
_LARGEST_LAG = 8


@dataclass(frozen=True)
class SlopeInformation:
    """Uncertainty of the SPC surface between neighbouring points, and of its heights.

    Parameters
    ----------
    step_sigma_m : float
        Standard deviation of the error of a height step between neighbours, metres, if steps were
        independent; large enough that over a few cells the surface is no more certain than
        observed.
    steep_sigma : float
        Addition (in quadrature) per unit of slope: SPC smooths where the surface is steep.
        Dimensionless; times the GSD it is metres.
    bend_sigma : float
        Addition per metre of bending (:mod:`spcola.grids.bending`): SPC rounds
        edges and flattens boulders. Dimensionless.
    height_sigma_m : float
        Standard deviation of the SPC heights about the lidar's after registration, metres.
    correlated_cells : float
        Number of neighbouring points over which SPC height errors are correlated.
    light_sigma : float
        Error of a brightness relative to its image's mean, estimated from the steps: times the root
        of a slope's variance (:mod:`spcola.photometry.slope_covariance`) it is its sigma.
    usual_light : float
        Variance of slopes by photoclinometry at which a step has `step_sigma_m`: the median of all
        steps.
    shape : ShapeErrors, optional
        Errors of the shape model; None if the lidar does not determine them.
    """

    step_sigma_m: float
    steep_sigma: float
    bend_sigma: float
    height_sigma_m: float
    correlated_cells: float
    light_sigma: float = 0.0
    usual_light: float = 0.0
    shape: ShapeErrors | None = None

    @property
    def assumed(self) -> bool:
        """Whether these are not estimated: too little of lidar and SPC overlaps."""
        return replace(self, shape=None) == DEFAULT_INFORMATION

    def step_sigma(
        self, slope: FloatArray, bend: FloatArray, gsd: float, light: FloatArray | None = None
    ) -> FloatArray:
        """Standard deviation, metres, of steps.

        Parameters
        ----------
        slope, bend : ndarrays
            Rise over run; bending, metres.
        gsd : float
            Metres.
        light : ndarray, optional
            Variance of the slope by photoclinometry; `usual_light` where it is not finite.
        """
        growth = np.hypot(self.steep_sigma * gsd * slope, self.bend_sigma * bend)
        if light is not None:
            known = np.where(np.isfinite(light), light, self.usual_light)
            poor = np.maximum(known - self.usual_light, 0.0)
            growth = np.hypot(growth, self.light_sigma * gsd * np.sqrt(poor))
        return np.hypot(self.step_sigma_m, growth)


DEFAULT_INFORMATION = SlopeInformation(
    step_sigma_m=0.05, steep_sigma=0.3, bend_sigma=0.3, height_sigma_m=0.15, correlated_cells=50.0
)
"""Assumed where lidar and SPC do not overlap: a step has half of the rms error that Weirich et al.
(2022) found for SPC models of Bennu's size, and errors are correlated over about seven points."""


def along_edges(layer: FloatArray, axis: int) -> FloatArray:
    """Return the larger value of the two ends of each edge along `axis`, in the order of steps."""
    return np.maximum(*ends(layer, 1, axis))


def light_along_edges(light: SlopeVariance, lag: int, axis: int) -> FloatArray:
    """Variance of the mean slope between points `lag` apart along `axis`, in the order of steps.

    It is the mean over the first and the last edge of the way, and over the cells on both sides of
    each, or the one whose slope is known: errors of neighbouring slopes are fully correlated, as
    they share images.
    """
    layer = light.along_x if axis == 1 else light.along_y
    outside = ((1, 1), (0, 0)) if axis == 1 else ((0, 0), (1, 1))
    left, right = ends(np.pad(layer, outside, constant_values=np.inf), 1, 1 - axis)
    both = np.isfinite(left) & np.isfinite(right)
    edges = np.where(both, 0.5 * (left + right), np.minimum(left, right))
    ahead, behind = ends(edges, lag - 1, axis)
    mean: FloatArray = 0.5 * (ahead + behind)
    return mean


@dataclass(frozen=True, eq=False)
class AlignedHeights:
    """Aligned lidar and SPC heights on one grid, from which SPC's errors are estimated.

    Parameters
    ----------
    lidar, spc : (2q+1, 2q+1) ndarrays
        Heights, metres; NaN where unknown.
    sigma : (2q+1, 2q+1) ndarray
        Of the lidar heights, metres.
    gsd : float
        Metres.
    light : SlopeVariance, optional
        Variance of the slopes from images.
    shape : (2q+1, 2q+1) ndarray, optional
        Heights of the shape model, metres.
    """

    lidar: FloatArray
    spc: FloatArray
    sigma: FloatArray
    gsd: float
    light: SlopeVariance | None = None
    shape: FloatArray | None = None


def estimate_information(comparisons: list[AlignedHeights]) -> SlopeInformation:
    """Estimate the uncertainty of SPC slopes and heights from their differences to a lidar.

    The lidar's own variance is subtracted. SPC errors are correlated over some cells, while energy
    (A) assumes independent step errors: their size is chosen so that over one to three cells the
    surface is nowhere more certain than observed
    (:func:`fusion.fusing.uncertainty.variogram.walk_sigma`).

    Parameters
    ----------
    comparisons : list of AlignedHeights
        Of one GSD, registered; gaps as NaN.

    Returns
    -------
    SlopeInformation
        :data:`DEFAULT_INFORMATION` where too little overlaps.
    """
    errors: list[FloatArray] = [pair.spc - pair.lidar for pair in comparisons]
    spread = np.concatenate([_centered(error) for error in errors]) if errors else np.empty(0)
    shape = _shape_information(comparisons)
    if spread.size < _ENOUGH:
        return replace(DEFAULT_INFORMATION, shape=shape)
    steps = [_steps(comparisons, errors, lag) for lag in range(1, _LARGEST_LAG + 1)]
    variogram = np.array([_excess(step.square, step.noise) for step in steps])
    noise = float(np.nanmedian([np.nanmedian(pair.sigma) for pair in comparisons]))
    height = float(np.sqrt(max(float(mad(spread)) ** 2 - noise**2, 1e-8)))
    steep, bend, light = _growth(steps[0], comparisons[0].gsd)
    return SlopeInformation(
        step_sigma_m=walk_sigma(variogram[:_STEP_REACH]),
        steep_sigma=steep,
        bend_sigma=bend,
        height_sigma_m=height,
        correlated_cells=correlated_cells(variogram, height),
        light_sigma=light,
        usual_light=float(np.median(steps[0].light)) if steps[0].light.size else 0.0,
        shape=shape,
    )


def _shape_information(comparisons: list[AlignedHeights]) -> ShapeErrors | None:
    """Errors of the shape on ground without SPC heights; on all ground if that is too little.

    The fusion uses the shape only there, and on unlit ground it may be less accurate.
    """
    known = [pair for pair in comparisons if pair.shape is not None]
    everywhere = [pair.lidar - pair.shape for pair in known if pair.shape is not None]
    alone = [np.where(np.isnan(p.spc), d, np.nan) for p, d in zip(known, everywhere, strict=True)]
    return estimate_shape_errors(alone) or estimate_shape_errors(everywhere)


@dataclass(frozen=True, eq=False)
class _Steps:
    """Squared differences (N,) of the error over one lag, and their possible causes.

    These are the lidar's variance, slope and bending, and the variance of the slope by
    photoclinometry (0 where it is not known).
    """

    square: FloatArray
    noise: FloatArray
    slope: FloatArray
    bend: FloatArray
    light: FloatArray


def _steps(comparisons: list[AlignedHeights], errors: list[FloatArray], lag: int) -> _Steps:
    parts: list[FloatArray] = []
    for pair, error in zip(comparisons, errors, strict=True):
        bent = np.abs(np.nan_to_num(bending(pair.lidar)))
        for axis in (0, 1):
            ahead, behind = ends(error, lag, axis)
            high, low = ends(pair.lidar, lag, axis)
            noise = np.hypot(*ends(pair.sigma, lag, axis)) ** 2
            slope = np.abs(high - low) / (lag * pair.gsd)
            bend = np.maximum(*ends(bent, lag, axis))
            light: FloatArray = np.zeros(slope.shape)
            if pair.light is not None:
                light = light_along_edges(pair.light, lag, axis)
            rows = np.stack([(ahead - behind) ** 2, noise, slope, bend, light])
            parts.append(rows[:, np.isfinite(rows).all(axis=0)])
    return _Steps(*np.concatenate(parts, axis=1))


def _centered(error: FloatArray) -> FloatArray:
    """Finite errors less their median."""
    known = error[np.isfinite(error)]
    return known - np.median(known) if known.size else known


def _excess(square: FloatArray, noise: FloatArray) -> float:
    """Variance of the differences in excess of the lidar's noise; at least 0.

    The median of a squared normal deviate is 0.4549 of its variance; the median makes it robust
    against boulders and outliers.
    """
    if not square.size:
        return 0.0
    return max(float(np.median(square)) / 0.4549 - float(np.median(noise)), 0.0)


def _growth(steps: _Steps, gsd: float) -> tuple[float, float, float]:
    """Growth of the step error with slope, with bending and with poor light.

    The excess variance of groups of steps similar in all three is fitted by a constant and three
    non-negative coefficients.
    """
    some = slice(None, None, -(-len(steps.slope) // _MOST_STEPS) or 1)
    causes = np.stack([steps.slope, steps.bend, np.sqrt(steps.light)], axis=1)[some]
    square, noise = steps.square[some], steps.noise[some]
    rows = []
    for chosen in _groups(causes):
        excess = _excess(square[chosen], noise[chosen])
        rows.append((1.0, *np.median(causes[chosen], axis=0) ** 2, excess))
    if len(rows) < _LEAST_GROUPS:
        return DEFAULT_INFORMATION.steep_sigma, DEFAULT_INFORMATION.bend_sigma, 0.0
    table = np.array(rows)
    # The sigma of an estimated variance is proportional to the variance.
    table /= np.maximum(table[:, 4:], max(float(np.median(table[:, 4])), 1e-12))
    found, _ = nnls(table[:, :4], table[:, 4])
    steep, bend, light = np.sqrt(found[1:])
    return float(steep) / gsd, float(bend), float(light) / gsd


def _groups(causes: FloatArray) -> list[IntArray]:
    """Split N rows of `causes` (N, C) at the medians of one column after the other.

    Stops before groups have fewer than :data:`_GROUP` rows; constant columns are skipped.
    """
    varied = [column for column in causes.T if np.ptp(column) > 0.0] if len(causes) else []
    groups: list[IntArray] = [np.arange(len(causes))]
    for round_ in range(len(varied) * 20):
        column, split = varied[round_ % len(varied)], []
        for group in groups:
            order = group[np.argsort(column[group], kind="stable")]
            split += [order[: len(order) // 2], order[len(order) // 2 :]]
        if len(split[0]) < _GROUP:
            break
        groups = split
    return groups if len(causes) >= _GROUP else []
