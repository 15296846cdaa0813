"""The match of one mapola to an SPC surface: three components, with a covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from fusion.registration.correlation import (
    independent_patches,
    residual_covariance,
    shift_variances,
)
from fusion.registration.resolution import blur, filled
from spcola.arrays import BoolArray, FloatArray
from spcola.maplet import MapletGrid
from spcola.robust import biweight, huber_weight, mad

# Two displacements further apart than this many cells are two answers.
_APART = 3.0
# Fewer independent differences than twice the parameters of a match give no covariance.
_MIN_PATCHES = 10.0
# Share of the points that count alike, as known best: a few that claim far more than the rest, or
# an error of 0, must not carry the match.
_BEST = 0.1
# Steps, cells, that go to and fro for ever: beside a gap the points compared change with the sign
# of the shift.
_TO_AND_FRO = 0.01
# The weights after each solution; those after the last enter the covariance alone.
_REWEIGHTINGS = (huber_weight, huber_weight, biweight, biweight, biweight)


@dataclass(frozen=True)
class MatchOptions:
    """How mapolas are matched.

    Parameters
    ----------
    capture_m : float
        Largest horizontal displacement that is searched, metres.
    min_coverage : float
        Smallest share of the grid that both surfaces must hold.
    min_correlation : float
        Smallest correlation of the two surfaces, planes removed, after the match.
    ambiguity : float
        Another displacement that leaves less than this multiple of the difference's variance
        makes the match ambiguous.
    max_iterations : int
        Most Gauss–Newton steps.
    """

    capture_m: float = 2.0
    min_coverage: float = 0.3
    min_correlation: float = 0.5
    ambiguity: float = 1.2
    max_iterations: int = 20


@dataclass(frozen=True, eq=False)
class Surface:
    """Heights on a grid and what is known of their errors.

    Parameters
    ----------
    height : (N, N) ndarray
        Metres along the grid's Uz; NaN where unknown.
    sigma : (N, N) ndarray, optional
        One standard deviation, metres; NaN or 0 where it is not known. Only how the sigmas of
        points compare matters to a match: their size is judged by what is left.
    """

    height: FloatArray
    sigma: FloatArray | None = None

    @property
    def variance(self) -> FloatArray:
        """Squared sigma (N, N), that of the middling point where it is not known; 0 if nowhere."""
        if self.sigma is None:
            return np.zeros(self.height.shape)
        known = np.isfinite(self.height) & (self.sigma > 0)
        usual = float(np.median(self.sigma[known])) if known.any() else 0.0
        variance: FloatArray = np.where(known, self.sigma, usual) ** 2
        return variance


@dataclass(frozen=True, eq=False)
class Match:
    """Where the lidar surface has to move to lie on the SPC surface.

    Attributes
    ----------
    name : str
    center : (3,) ndarray
        V of the mapola before the move, body-fixed, metres.
    displacement : (3,) ndarray
        d, body-fixed, metres: ``V + d`` is the centre in SPC coordinates. NaN if not matched.
    covariance : (3, 3) ndarray
        Of d, square metres, from the match itself: the curvature of the misfit under the
        spatial correlation that the remaining differences show.
    local : (3,) ndarray
        d along Ux, Uy, Uz.
    residual : (2q+1, 2q+1) ndarray
        SPC minus moved lidar height, metres; NaN where not compared.
    correlation, coverage : float
        Of the surfaces (planes removed) after the match; share of the grid compared.
    iterations : int
    reason : str
        Empty if the match is good, else why it must not be used.
    """

    name: str
    center: FloatArray
    displacement: FloatArray
    covariance: FloatArray
    local: FloatArray
    residual: FloatArray
    correlation: float
    coverage: float
    iterations: int
    reason: str

    @property
    def usable(self) -> bool:
        """Whether the match may enter a fit."""
        return not self.reason


@dataclass(frozen=True, eq=False)
class _Pair:
    """Two surfaces on one grid at one resolution; gaps filled smoothly."""

    moving: FloatArray  # the lidar heights, filled
    moving_mask: BoolArray
    fixed: FloatArray
    fixed_mask: BoolArray
    sigma: FloatArray  # of their difference, against that of the points known best
    gsd: float


def match_surfaces(
    name: str,
    grid: MapletGrid,
    moving: Surface,
    fixed: Surface,
    *,
    blur_cells: float = 0.0,
    options: MatchOptions | None = None,
) -> Match:
    """Match the lidar heights `moving` to the SPC heights `fixed` on one grid.

    The difference ``fixed(x) − moving(x − d) − d_z − plane``, in units of the two surfaces'
    sigmas, is made smallest in the sense of Huber: first on whole cells over the capture range,
    then by Gauss–Newton at sub-cell accuracy. The plane is a nuisance: a maplet's own long-wave
    tilt must not be taken for a displacement of a sloping surface. Ground that SPC hardly knows,
    as in shadow, where its heights drift by decimetres together, has little say.

    Parameters
    ----------
    name : str
    grid : MapletGrid
        Grid of both.
    moving, fixed : Surface
        Of the grid's shape.
    blur_cells : float
        Standard deviation, in cells, of the Gaussian that brings the sharper surface (lidar if
        positive, SPC if negative) to the resolution of the other.
    options : MatchOptions, optional

    Returns
    -------
    Match
        With NaN displacement and a `reason` where nothing trustworthy was found.
    """
    options = options or MatchOptions()
    pair = _prepare(grid, moving, fixed, blur_cells)
    both = float(np.mean(pair.moving_mask & pair.fixed_mask))
    if both < options.min_coverage:
        return _unmatched(name, grid, both, f"only {both:.0%} of the grid is held by both surfaces")
    start, rivals = _coarse(pair, options)
    if max(abs(start)) == _reach(pair, options) > 1:
        edge = f"the best match lies at the edge of the capture range ({options.capture_m:g} m)"
        return _unmatched(name, grid, both, edge)
    fine = _refine(pair, start, options)
    if fine is None:
        return _unmatched(name, grid, both, "the terrain has no relief to hold the match")
    others = [_refine(pair, rival, options) for rival in rivals]
    if any(other and _as_good(other, fine, options) for other in others):
        return _unmatched(
            name, grid, both, "two displacements fit alike (flat or periodic terrain)"
        )
    return _judged(name, grid, pair, fine, options)


def _prepare(grid: MapletGrid, moving: Surface, fixed: Surface, blur_cells: float) -> _Pair:
    """Bring both surfaces to one resolution and fill their gaps."""
    soft_moving = blur(moving.height, blur_cells) if blur_cells > 0 else moving.height
    soft_fixed = blur(fixed.height, -blur_cells) if blur_cells < 0 else fixed.height
    return _Pair(
        filled(soft_moving),
        np.isfinite(soft_moving),
        filled(soft_fixed),
        np.isfinite(soft_fixed),
        _relative_sigma(moving, fixed),
        grid.gsd,
    )


def _relative_sigma(moving: Surface, fixed: Surface) -> FloatArray:
    """Sigma of the difference at each point against that of the points known best, at least 1.

    The displacements searched for are small against how far sigmas reach: where they lie before
    the move is good enough.
    """
    sigma: FloatArray = np.sqrt(moving.variance + fixed.variance)
    both = np.isfinite(moving.height) & np.isfinite(fixed.height)
    if not (sigma[both] > 0).any():
        return np.ones(sigma.shape)
    best = float(np.quantile(sigma[both], _BEST))
    return np.maximum(sigma / best, 1.0)


def _reach(pair: _Pair, options: MatchOptions) -> int:
    """Capture range in whole cells."""
    return max(1, int(np.ceil(options.capture_m / pair.gsd)))


def _coarse(pair: _Pair, options: MatchOptions) -> tuple[FloatArray, list[FloatArray]]:
    """Best whole-cell shift (x, y), in cells, and up to three others that may rival it.

    A rival is a valley of the difference's variance, apart from the best one, that is about as
    deep, or deep against what unrelated terrain shows.
    """
    reach = _reach(pair, options)
    weight = np.where(pair.fixed_mask, pair.sigma**-2, 0.0)
    variance = shift_variances(pair.moving, pair.moving_mask, pair.fixed, weight, reach=reach)
    best = np.unravel_index(int(np.nanargmin(variance)), variance.shape)
    start = np.array([best[1] - reach, best[0] - reach], dtype=np.float64)
    depth = max(
        options.ambiguity * _valley_floor(variance, int(best[0]), int(best[1])),
        0.25 * float(np.nanmedian(variance)),
    )
    valleys = np.argwhere(ndimage.minimum_filter(variance, size=5, mode="nearest") == variance)
    found = [
        (_valley_floor(variance, row, column), column - reach, row - reach)
        for row, column in valleys.tolist()
        if np.hypot(row - best[0], column - best[1]) > _APART
    ]
    rivals = sorted(rival for rival in found if rival[0] < depth)[:3]
    return start, [np.array(rival[1:], dtype=np.float64) for rival in rivals]


def _as_good(other: _Fine, best: _Fine, options: MatchOptions) -> bool:
    """Whether another displacement leaves about the same difference as the best one."""
    apart = float(np.hypot(*(other.shift - best.shift))) > _APART
    spread, least = (float(np.nanvar(fine.standardised)) for fine in (other, best))
    return apart and spread < options.ambiguity * least


def _valley_floor(variance: FloatArray, row: int, column: int) -> float:
    """Lowest variance near a whole-cell minimum, by a parabola along each axis.

    Between whole cells a steep valley can be far deeper than at any of them.
    """
    middle = float(variance[row, column])
    floor = middle
    for before, after in (
        ((row - 1, column), (row + 1, column)),
        ((row, column - 1), (row, column + 1)),
    ):
        if min(before) < 0 or max(after) >= len(variance):
            continue
        left, right = float(variance[before]), float(variance[after])
        bend = left - 2.0 * middle + right
        if np.isfinite(bend) and bend > 0:
            floor -= (right - left) ** 2 / (8.0 * bend)
    return max(floor, 0.0)


@dataclass(frozen=True, eq=False)
class _Fine:
    shift: FloatArray  # (x, y) cells
    dz: float  # metres
    covariance: FloatArray  # (3, 3) of (x cells, y cells, z metres)
    residual: FloatArray
    standardised: FloatArray  # the same over the relative sigma
    compared: BoolArray
    moved: FloatArray
    iterations: int
    settled: bool


def _refine(pair: _Pair, start: FloatArray, options: MatchOptions) -> _Fine | None:
    """Gauss–Newton on the resampled lidar surface; None where the normal matrix is singular."""
    size = pair.moving.shape[0]
    coefficients = ndimage.spline_filter(pair.moving, order=3)
    holes = (~pair.moving_mask).astype(np.float64)
    y, x = np.mgrid[:size, :size].astype(np.float64)
    tilt_x, tilt_y = (x - (size - 1) / 2) / size, (y - (size - 1) / 2) / size
    shift = start.copy()
    iterations, settled = 0, False
    while not settled and iterations < options.max_iterations:
        iterations += 1
        where = np.stack([y - shift[1], x - shift[0]])
        moved = ndimage.map_coordinates(
            coefficients, where, order=3, prefilter=False, mode="nearest"
        )
        hole = ndimage.map_coordinates(holes, where, order=1, mode="constant", cval=1.0)
        compared = pair.fixed_mask & (hole < 1e-6)
        slope_y, slope_x = np.gradient(moved)
        design = np.stack([-slope_x, -slope_y, np.ones_like(moved), tilt_x, tilt_y], axis=-1)
        design /= pair.sigma[..., None]
        rows, difference = design[compared], ((pair.fixed - moved) / pair.sigma)[compared]
        if len(rows) < 30:
            return None
        step = _robust_step(rows, difference)
        if step is None:
            return None
        offsets, weight = step
        shift = shift + np.clip(offsets[:2], -1.0, 1.0)
        enough = 1e-4 if 2 * iterations <= options.max_iterations else _TO_AND_FRO
        settled = bool(np.max(np.abs(offsets[:2])) < enough)
    standardised = np.full_like(moved, np.nan)
    standardised[compared] = difference - rows[:, 2:] @ offsets[2:]
    weights = np.zeros_like(moved)
    weights[compared] = weight
    return _Fine(
        shift=shift,
        dz=float(offsets[2]),
        covariance=residual_covariance(design, weights, standardised)[:3, :3],
        residual=standardised * pair.sigma,
        standardised=standardised,
        compared=compared,
        moved=moved,
        iterations=iterations,
        settled=settled,
    )


def _robust_step(rows: FloatArray, difference: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Robust least squares (a few re-weightings); None where columns depend.

    First Huber's weights, which lead anywhere near, then Tukey's: boulders that SPC shortens all
    lie to one side, and any weight left to them pulls the height. Returns the offsets (P,) and the
    weights (N,).
    """
    weight: FloatArray = np.ones(len(rows))
    offsets: FloatArray = np.zeros(rows.shape[1])
    scale = np.sqrt(np.mean(rows**2, axis=0))
    if np.min(scale) < 1e-9:
        return None
    unit = rows / scale
    for weigh in _REWEIGHTINGS:
        weighted = unit * weight[:, None]
        normal = weighted.T @ unit
        if np.linalg.cond(normal) > 1e10:
            return None
        offsets = np.linalg.solve(normal, weighted.T @ difference)
        rest = difference - unit @ offsets
        spread = float(mad(rest))
        if spread <= 1e-12:
            break
        weight = weigh(rest / spread)
    return offsets / scale, weight


def _judged(name: str, grid: MapletGrid, pair: _Pair, fine: _Fine, options: MatchOptions) -> Match:
    """Turn a refined match into the result, with the reason if it cannot be trusted."""
    step = np.diag([grid.gsd, grid.gsd, 1.0])
    local = step @ np.array([*fine.shift, fine.dz])
    covariance = step @ fine.covariance @ step
    correlation = _correlation(pair, fine)
    coverage = float(np.mean(fine.compared))
    reason = ""
    patches = independent_patches(fine.standardised)
    if coverage < options.min_coverage:
        reason = f"only {coverage:.0%} of the grid could be compared"
    elif not fine.settled:
        reason = f"the displacement still moved after {fine.iterations} steps"
    elif patches < _MIN_PATCHES:
        reason = (
            f"the differences hold together over so far that only {patches:.0f} are independent"
        )
    elif correlation < options.min_correlation:
        reason = f"the surfaces correlate by {correlation:.2f} only"
    elif np.hypot(local[0], local[1]) > options.capture_m:
        reason = f"the displacement left the capture range ({options.capture_m} m)"
    return Match(
        name=name,
        center=grid.center,
        displacement=grid.axes.T @ local,
        covariance=grid.axes.T @ covariance @ grid.axes,
        local=local,
        residual=fine.residual,
        correlation=correlation,
        coverage=coverage,
        iterations=fine.iterations,
        reason=reason,
    )


def _correlation(pair: _Pair, fine: _Fine) -> float:
    """Weighted correlation of the two surfaces, planes removed, over the compared points."""
    rows, columns = np.nonzero(fine.compared)
    share = 1.0 / pair.sigma[fine.compared][:, None]
    plane = share * np.stack([np.ones(len(rows)), rows, columns], axis=1)
    both = share * np.stack([pair.fixed[fine.compared], fine.moved[fine.compared]], axis=1)
    rest = both - plane @ np.linalg.lstsq(plane, both, rcond=None)[0]
    product = rest.T @ rest
    scale = np.sqrt(product[0, 0] * product[1, 1])
    return float(product[0, 1] / scale) if scale > 0 else 0.0


def _unmatched(name: str, grid: MapletGrid, coverage: float, reason: str) -> Match:
    """Return a match that says why there is none."""
    unknown = np.full(3, np.nan)
    return Match(
        name=name,
        center=grid.center,
        displacement=unknown,
        covariance=np.full((3, 3), np.nan),
        local=unknown,
        residual=np.full(grid.shape, np.nan),
        correlation=float("nan"),
        coverage=coverage,
        iterations=0,
        reason=reason,
    )
