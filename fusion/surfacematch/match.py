"""The match of one mapola to an SPC surface: three components, with a covariance."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fusion.surfacematch.alignment import (
    Aligner,
    Alignment,
    Fields,
    Left,
    Search,
    tilts,
    tipping,
)
from fusion.surfacematch.coarse import APART, AREA, coarse_shift
from fusion.surfacematch.resolution.noise import NoiseSpectrum, bridged, supported
from fusion.surfacematch.resolution.resolution import blurred_over_gaps, plane_of
from fusion.surfacematch.weights import BEST_SHARE
from spcola.arrays import BoolArray, FloatArray
from spcola.grids import MapletGrid, closable

# Fewer independent differences than twice the parameters of a match give no covariance.
_MIN_PATCHES = 10.0
# Ground that differs by no more than this many of its stated sigmas is the same ground, however
# little relief there is to correlate.
_AS_STATED = 2.0
# A filtered match further from the unfiltered one than this many of the latter's sigmas has found
# another valley.
_TORN = 5.0
# Share of a grid: so many gaps of the displaced surface do not matter.
_FEW = 0.03
# A displacement that moves by less than that, cells, has settled; one that is a start for another
# search, or a rival, sooner.
_SETTLED, _ROUGH = 1e-3, 0.03
# No displacement is known better than this, cells.
_ROUNDING = 1e-6


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
    max_iterations: int = 50


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
    of_slopes : bool
        Whether it is smooth because its slopes are, as those of maplets, or because its heights
        are, as those of facets: a chord lies below a round body.
    """

    height: FloatArray
    sigma: FloatArray | None = None
    of_slopes: bool = True

    @property
    def variance(self) -> FloatArray:
        """Squared sigma (N, N), that of the middling point where it is not known; 0 if nowhere."""
        if self.sigma is None:
            return np.zeros(self.height.shape)
        known = np.isfinite(self.height) & (self.sigma > 0)
        if known.all():
            return self.sigma**2
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
        SPC minus moved lidar height less their plane, metres; NaN where not compared.
    correlation, coverage : float
        Of the surfaces (planes removed) after the match; share of the grid compared.
    iterations : int
    reason : str
        Empty if the match is good, else why it must not be used.
    at_lidar : bool
        Whether the residual is at the grid points of the lidar, the SPC surface being displaced to
        them, as the lidar has many gaps; else it is at those of the SPC surface.
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
    at_lidar: bool = False

    @property
    def usable(self) -> bool:
        """Whether the match may enter a fit."""
        return not self.reason

    def on_one_grid(self, lidar: FloatArray, spc: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Heights (N, N) of lidar and SPC at the same ground, from those that were matched, metres.

        Of the one that is not displaced as they are; of the other NaN where nothing was compared.
        """
        return (lidar, lidar + self.residual) if self.at_lidar else (spc - self.residual, spc)


@dataclass(frozen=True, eq=False)
class _Pair:
    """Two surfaces on one grid at one resolution, less the plane that they have in common.

    A value between points rests on the points around it. Where many of the lidar's are missing the
    SPC surface is displaced instead, and compared at the points that the lidar has: gaps that are
    closed from one side draw a displacement towards whole cells, by a third of its sigma where 5 %
    are missing, by more than one sigma where 30 % are. Else it is the lidar, whose slopes, by which
    the points weigh, have less noise.
    """

    moving: FloatArray
    fixed: FloatArray
    plane: FloatArray  # (3,) height in the middle, rise over the grid along x and y
    sigma: FloatArray  # of their difference, against that of the points known best
    stated: float  # metres, what a `sigma` of 1 is; 0 where none is known
    gsd: float
    turned: bool = False  # whether `moving` is the SPC surface and `fixed` the lidar's

    @property
    def moving_known(self) -> BoolArray:
        return np.isfinite(self.moving)

    @property
    def fixed_known(self) -> BoolArray:
        return np.isfinite(self.fixed)

    def with_few_gaps_moving(self) -> _Pair:
        """The pair, turned if the moving surface lacks many more points than the fixed one."""
        lacking = np.count_nonzero(self.fixed_known) - np.count_nonzero(self.moving_known)
        if lacking <= _FEW * self.moving.size:
            return self
        return replace(self, moving=self.fixed, fixed=self.moving, turned=True)


def match_surfaces(
    name: str,
    grid: MapletGrid,
    moving: Surface,
    fixed: Surface,
    *,
    blur_cells: float = 0.0,
    spectrum: NoiseSpectrum | None = None,
    options: MatchOptions | None = None,
) -> Match:
    """Match the lidar heights `moving` to the SPC heights `fixed` on one grid.

    The likelihood of the difference ``fixed(x) − moving(x − d) − d_z − plane`` is made greatest,
    given how both surfaces' sigmas vary from point to point and, with `spectrum`, over which
    wavelengths the errors are spread; robustly (Huber, then Tukey): first on whole cells over the
    capture range, then by Gauss–Newton at sub-cell accuracy. The plane is a nuisance: a maplet's
    own long-wave tilt must not be taken for a displacement of a sloping surface. Ground that SPC
    hardly knows, as in shadow, where its heights drift by decimetres together, has little say.
    What the relief does not tell stays 0 within the capture range, which is its sigma then.

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
    spectrum : NoiseSpectrum, optional
        Of the difference of such surfaces; white by default.
    options : MatchOptions, optional

    Returns
    -------
    Match
        With NaN displacement and a `reason` where nothing trustworthy was found.
    """
    options = options or MatchOptions()
    pair = _prepare(grid, moving, fixed, blur_cells).with_few_gaps_moving()
    both = float(np.mean(pair.moving_known & pair.fixed_known))
    if both < options.min_coverage:
        return unmatched(name, grid, both, f"only {both:.0%} of the grid is held by both surfaces")
    fields, reach = _plain(pair), max(1, int(np.ceil(options.capture_m / grid.gsd)))
    start, rivals = coarse_shift(fields, reach=reach, ambiguity=options.ambiguity)
    if max(abs(start)) == reach > 1:
        edge = f"the best match lies at the edge of the capture range ({options.capture_m:g} m)"
        return unmatched(name, grid, both, edge)
    aligner = Aligner.of(fields)
    rough = Search(options.capture_m / grid.gsd, options.max_iterations, _ROUGH, AREA)
    plain = aligner.align(start, rough)
    if plain is None:
        return unmatched(name, grid, both, "too few points are common to both surfaces")
    others = [aligner.align(rival, rough) for rival in rivals]
    alike = [other for other in others if other and _as_good(other, plain, options)]
    sharp = None if spectrum is None or alike else _whitened(fields, spectrum, plain, rough)
    if sharp is None:
        best = aligner.align(plain.shift, replace(rough, tolerance=_SETTLED, area=0.0)) or plain
        return _judged(name, grid, pair, _Found(best, best.left, alike), options)
    return _judged(
        name, grid, pair, _Found(sharp, aligner.left_at(sharp.shift, sharp.plane), alike), options
    )


def _prepare(grid: MapletGrid, moving: Surface, fixed: Surface, blur_cells: float) -> _Pair:
    """Bring both surfaces to one resolution, and take out the plane of the fixed one."""
    soft_moving, soft_fixed = moving.height, fixed.height
    if blur_cells > 0:
        soft_moving = blurred_over_gaps(soft_moving, blur_cells, of_slopes=fixed.of_slopes)
    elif blur_cells < 0:
        soft_fixed = blurred_over_gaps(soft_fixed, -blur_cells, of_slopes=moving.of_slopes)
    plane = plane_of(soft_fixed)
    rows, columns = plane.shape
    rise = np.array(
        [
            plane.mean(),
            (plane[0, -1] - plane[0, 0]) * columns / (columns - 1),
            (plane[-1, 0] - plane[0, 0]) * rows / (rows - 1),
        ]
    )
    sigma, stated = _relative_sigma(moving, fixed)
    return _Pair(soft_moving - plane, soft_fixed - plane, rise, sigma, stated, grid.gsd)


def _relative_sigma(moving: Surface, fixed: Surface) -> tuple[FloatArray, float]:
    """Sigma of the difference at each point against that of the points known best, at least 1.

    Second that of these points, metres; 0 where none is stated. The displacements searched for are
    small against how far sigmas reach: where they lie before the move is good enough.
    """
    sigma: FloatArray = np.sqrt(moving.variance + fixed.variance)
    both = np.isfinite(moving.height) & np.isfinite(fixed.height)
    if not (sigma[both] > 0).any():
        return np.ones(sigma.shape), 0.0
    known = sigma[both]
    place = int(BEST_SHARE * len(known))
    best = float(np.partition(known, place)[place])
    return np.maximum(sigma / best, 1.0), best


def _as_good(other: Alignment, best: Alignment, options: MatchOptions) -> bool:
    """Whether another displacement leaves about the same difference as the best one."""
    apart = float(np.hypot(*(other.shift - best.shift))) > APART
    spread, least = (float(np.nanvar(one.left.standardised)) for one in (other, best))
    return apart and spread < options.ambiguity * least


def _plain(pair: _Pair) -> Fields:
    """The surfaces as they are, all wavelengths alike."""
    # That of SPC has the smoother slopes.
    spc = bridged(pair.moving if pair.turned else pair.fixed)
    level = pair.plane[0] + np.tensordot(pair.plane[1:], tilts(spc.shape), axes=1)
    return Fields(
        bridged(pair.moving),
        pair.moving_known,
        closable(pair.moving_known),
        bridged(pair.fixed),
        pair.fixed_known,
        pair.sigma,
        np.ascontiguousarray(tipping(spc + level, pair.gsd)),
        1.0,
    )


def _whitened(
    plain_fields: Fields, spectrum: NoiseSpectrum, plain: Alignment, search: Search
) -> Alignment | None:
    """Align the surfaces again, filtered so that their difference is white; None if no better.

    Where gaps leave too little that the filter can be sure of, or the relief has nothing at short
    wavelengths, the unfiltered answer is the sharper one.
    """
    moving, fixed, *tipped = spectrum.whitened(
        np.stack([plain_fields.moving, plain_fields.fixed, *plain_fields.tipping])
    )
    fields = Fields(
        moving,
        supported(plain_fields.moving_known),
        supported(plain_fields.moving_near),
        fixed,
        supported(plain_fields.fixed_known),
        plain_fields.sigma,
        np.stack(tipped),
        spectrum.level,
    )
    fine = replace(search, tolerance=_SETTLED, area=0.0)
    sharp = Aligner.of(fields).align(plain.shift, fine)
    if sharp is None or not sharp.settled or not np.isfinite(sharp.covariance).all():
        return None
    moved = sharp.shift - plain.shift
    apart = moved @ np.linalg.solve(plain.covariance[:2, :2], moved)
    gained = np.trace(sharp.covariance[:2, :2]) < np.trace(plain.covariance[:2, :2])
    return sharp if gained and apart < _TORN**2 else None


@dataclass(frozen=True, eq=False)
class _Found:
    """The displacement, what is left there of the unfiltered difference, and others as good."""

    best: Alignment
    left: Left
    alike: list[Alignment]


def _judged(
    name: str, grid: MapletGrid, pair: _Pair, found: _Found, options: MatchOptions
) -> Match:
    """Turn an alignment into the result, with the reason if it cannot be trusted."""
    local, covariance = _in_metres(pair, found, options)
    left = found.left
    correlation = _correlation(pair, left)
    coverage = float(np.mean(left.compared))
    return Match(
        name=name,
        center=grid.center,
        displacement=grid.axes.T @ local,
        covariance=grid.axes.T @ covariance @ grid.axes,
        local=local,
        residual=left.standardised * pair.sigma * (-1.0 if pair.turned else 1.0),
        correlation=correlation,
        coverage=coverage,
        iterations=found.best.iterations,
        reason=_objection(pair, found, options, correlation, local),
        at_lidar=pair.turned,
    )


def _in_metres(pair: _Pair, found: _Found, options: MatchOptions) -> tuple[FloatArray, FloatArray]:
    """Displacement (3,) along the grid's axes, metres, and its covariance.

    Along a direction in which others fit as well it is not known within the capture range.
    """
    best, slope = found.best, pair.plane[1:] / pair.moving.shape[::-1]
    covariance = best.covariance[:3, :3].copy()
    for other in found.alike:
        along = other.shift - best.shift
        reach = options.capture_m / pair.gsd
        covariance[:2, :2] += np.outer(along, along) * reach**2 / (along @ along)
    # The plane that was taken out has moved too.
    to_metres = np.diag([pair.gsd, pair.gsd, 1.0])
    to_metres[2, :2] = slope
    up = best.plane[0]
    if pair.turned:
        # The plane is where the points of the lidar are, and the middle is that of the SPC surface.
        up += best.plane[1:] @ (best.shift / pair.moving.shape[::-1])
        to_metres = -to_metres
    spread = _positive(to_metres @ covariance @ to_metres.T, _ROUNDING * pair.gsd)
    return to_metres @ np.array([*best.shift, up]), spread


def _positive(covariance: FloatArray, least: float) -> FloatArray:
    """A covariance (3, 3) with no sigma below `least`: that of equal surfaces is rounding."""
    if not np.isfinite(covariance).all():
        return covariance
    values, vectors = np.linalg.eigh(covariance)
    if values[0] >= least**2:
        return covariance
    positive: FloatArray = (vectors * np.maximum(values, least**2)) @ vectors.T
    return positive


def _objection(
    pair: _Pair, found: _Found, options: MatchOptions, correlation: float, local: FloatArray
) -> str:
    """Why a match must not be used; empty if it may."""
    best, left = found.best, found.left
    coverage, patches = float(np.mean(left.compared)), best.patches
    if coverage < options.min_coverage:
        return f"only {coverage:.0%} of the grid could be compared"
    if not best.settled:
        return f"the displacement still moved after {best.iterations} steps"
    if patches < _MIN_PATCHES:
        return f"the differences hold together over so far that only {patches:.0f} are independent"
    if correlation < options.min_correlation and not _as_stated(pair, left):
        return f"the surfaces correlate by {correlation:.2f} only"
    if np.hypot(local[0], local[1]) > options.capture_m:
        return f"the displacement left the capture range ({options.capture_m} m)"
    return ""


def _as_stated(pair: _Pair, left: Left) -> bool:
    """Whether the surfaces differ by no more than their sigmas say."""
    return float(np.nanstd(left.standardised)) <= _AS_STATED * pair.stated


def _correlation(pair: _Pair, left: Left) -> float:
    """Weighted correlation of the two surfaces, planes removed, over the compared points."""
    compared = left.compared
    rows, columns = pair.sigma.shape
    layers = np.stack([np.ones(compared.shape), *tilts((rows, columns)), pair.fixed, left.moved])
    rows = np.where(compared, layers / pair.sigma, 0.0).reshape(len(layers), -1)
    both = rows @ rows.T
    product = both[3:, 3:] - both[3:, :3] @ np.linalg.solve(both[:3, :3], both[:3, 3:])
    scale = np.sqrt(product[0, 0] * product[1, 1])
    return float(product[0, 1] / scale) if scale > 0 else 0.0


def unmatched(name: str, grid: MapletGrid, coverage: float, reason: str) -> Match:
    """Return a match on `grid` that says why there is none: NaN but for the share compared."""
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
