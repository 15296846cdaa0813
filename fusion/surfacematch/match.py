"""The match of one mapola to an SPC surface: three components, with a covariance."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fusion.estimation.verdict import Cause
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
from fusion.surfacematch.resolution.noise import NoiseSpectrum, supported
from fusion.surfacematch.resolution.resolution import blurred_over_gaps
from fusion.surfacematch.values import Match, MatchOptions, Surface, judged_match, unmatched
from fusion.surfacematch.weights import BEST_SHARE
from spcola.arrays import BoolArray, FloatArray
from spcola.grids import MapletGrid
from spcola.grids.gaps import bridged, closable, plane_of

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
        few = f"only {both:.0%} of the grid is held by both surfaces"
        return unmatched(name, grid, both, Cause.NOT_COVERED, few)
    fields, reach = _plain(pair), max(1, int(np.ceil(options.capture_m / grid.gsd)))
    start, rivals = coarse_shift(fields, reach=reach, ambiguity=options.ambiguity)
    if max(abs(start)) == reach > 1:
        edge = f"the best match lies at the edge of the capture range ({options.capture_m:g} m)"
        return unmatched(name, grid, both, Cause.CAPTURE_RANGE, edge)
    aligner = Aligner.of(fields)
    rough = Search(options.capture_m / grid.gsd, options.max_iterations, _ROUGH, AREA)
    plain = aligner.align(start, rough)
    if plain is None:
        few = "too few points are common to both surfaces"
        return unmatched(name, grid, both, Cause.NOT_COVERED, few)
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
    match = Match(
        name=name,
        center=grid.center,
        displacement=grid.axes.T @ local,
        covariance=grid.axes.T @ covariance @ grid.axes,
        local=local,
        residual=left.standardised * pair.sigma * (-1.0 if pair.turned else 1.0),
        correlation=_correlation(pair, left),
        coverage=float(np.mean(left.compared)),
        iterations=found.best.iterations,
        reason="",
        at_lidar=pair.turned,
    )
    best = found.best
    judged = judged_match(match, options, settled=best.settled, patches=best.patches)
    if judged.cause is Cause.UNCORRELATED and _as_stated(pair, left):
        alike = replace(options, min_correlation=-1.0)
        return judged_match(match, alike, settled=best.settled, patches=best.patches)
    return judged


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
