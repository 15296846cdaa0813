"""The match of one mapola to an SPC surface: three components, with a covariance."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fusion.estimation.verdict import Cause
from fusion.surfacematch.alignment import (
    Aligner,
    Alignment,
    Fields,
    Residual,
    Search,
    tilt_partials,
    tilts,
)
from fusion.surfacematch.coarse_shift import APART, AREA, CoarseShift, coarse_shift
from fusion.surfacematch.displacement_kernels import gauss_newton
from fusion.surfacematch.resolution.noise import NoiseSpectrum, supported
from fusion.surfacematch.resolution.resolution import blurred_over_gaps
from fusion.surfacematch.values import Match, MatchOptions, Surface
from fusion.surfacematch.weights import BEST_SHARE
from spcola.arrays import BoolArray, FloatArray
from spcola.grids import MapletGrid
from spcola.grids.gaps import bridged, closable, plane_of

MATCH_KERNEL = gauss_newton
"""The kernel of a match that takes longest to compile."""
# Surfaces that differ by no more than this many stated sigmas show the same ground, however little
# relief there is to correlate.
_WITHIN_STATED = 2.0
# A filtered match further from the unfiltered one than this many of the latter's sigmas has found
# another minimum.
_OTHER_MINIMUM = 5.0
# Share of a grid: fewer additional gaps of the displaced surface do not matter.
_FEW = 0.03
# Tolerances of a displacement, cells: of the result, and of an alternative or a start.
_FINE, _ROUGH = 1e-3, 0.03
# Smallest sigma of a displacement, cells.
_ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class _Pair:
    """Two surfaces on one grid at one resolution, less the plane that they have in common.

    Usually the lidar surface is displaced (interpolated), as its slopes have less noise. Where many
    of its points are missing the SPC surface is displaced instead and compared at the points that
    the lidar has: interpolating over one-sided gaps biases a displacement towards whole cells, by
    a third of its sigma with 5 % missing, by more than one sigma with 30 %.
    """

    moving: FloatArray
    fixed: FloatArray
    plane: FloatArray  # (3,) height in the middle, rise over the grid along x and y
    sigma: FloatArray  # of their difference, relative to that of the most accurate points
    stated: float  # metres that correspond to a `sigma` of 1; 0 if no sigma is known
    gsd: float
    swapped: bool = False  # whether `moving` is the SPC surface and `fixed` the lidar's

    @property
    def moving_known(self) -> BoolArray:
        return np.isfinite(self.moving)

    @property
    def fixed_known(self) -> BoolArray:
        return np.isfinite(self.fixed)

    def with_few_gaps_moving(self) -> _Pair:
        """Return the pair, swapped if the moving surface lacks many more points than the other."""
        lacking = np.count_nonzero(self.fixed_known) - np.count_nonzero(self.moving_known)
        if lacking <= _FEW * self.moving.size:
            return self
        return replace(self, moving=self.fixed, fixed=self.moving, swapped=True)


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

    The likelihood of the difference ``fixed(x) − moving(x − d) − d_z − plane`` is maximised
    robustly (Huber, then Tukey), given the relative sigmas of the points and, with `spectrum`, the
    power spectrum of the errors: first on whole cells over the capture range, then by Gauss–Newton
    at sub-cell accuracy. The plane is a nuisance parameter: a maplet's own long-wave tilt must not
    be mistaken for a displacement of a sloping surface. Ground with large SPC sigmas, as in shadow,
    has little weight. Directions that the relief does not determine have displacement 0 and the
    capture range as sigma.

    Parameters
    ----------
    name : str
    grid : MapletGrid
        Grid of both.
    moving, fixed : Surface
        With layers of the grid's shape.
    blur_cells : float
        Standard deviation, in cells, of the Gaussian that brings the sharper surface (lidar if
        positive, SPC if negative) to the resolution of the other.
    spectrum : NoiseSpectrum, optional
        Of the difference of such surfaces; white by default.
    options : MatchOptions, optional

    Returns
    -------
    Match
        With NaN displacement and a `reason` if there is no trustworthy match.
    """
    options = options or MatchOptions()
    pair = _prepare(grid, moving, fixed, blur_cells).with_few_gaps_moving()
    both = float(np.mean(pair.moving_known & pair.fixed_known))
    if both < options.min_coverage:
        few = f"only {both:.0%} of the grid has both surfaces"
        return Match.failed(name, grid, both, Cause.NOT_COVERED, few)
    fields, reach = _plain(pair), max(1, int(np.ceil(options.capture_m / grid.gsd)))
    shift = coarse_shift(fields, reach=reach, ambiguity=options.ambiguity)
    if max(abs(shift.start)) == reach > 1:
        edge = f"the best match lies at the edge of the capture range ({options.capture_m:g} m)"
        return Match.failed(name, grid, both, Cause.CAPTURE_RANGE, edge)
    rough = Search(options.capture_m / grid.gsd, options.max_iterations, _ROUGH, AREA)
    found = _found(fields, shift, spectrum, rough, options)
    if found is None:
        few = "too few points are common to both surfaces"
        return Match.failed(name, grid, both, Cause.NOT_COVERED, few)
    return _judged(name, grid, pair, found, options)


def _found(
    fields: Fields,
    shift: CoarseShift,
    spectrum: NoiseSpectrum | None,
    rough: Search,
    options: MatchOptions,
) -> _Found | None:
    """Align the surfaces from a whole-cell shift; None if too few points are common."""
    aligner = Aligner.of(fields)
    plain = aligner.align(shift.start, rough)
    if plain is None:
        return None
    others = [aligner.align(other, rough) for other in shift.alternatives]
    alternatives = [other for other in others if other and _as_good(other, plain, options)]
    sharp = None if spectrum is None or alternatives else _whitened(fields, spectrum, plain, rough)
    if sharp is not None:
        return _Found(sharp, aligner.residual_at(sharp.shift, sharp.plane), alternatives)
    best = aligner.align(plain.shift, replace(rough, tolerance=_FINE, area=0.0)) or plain
    return _Found(best, best.residual, alternatives)


def _prepare(grid: MapletGrid, moving: Surface, fixed: Surface, blur_cells: float) -> _Pair:
    """Bring both surfaces to one resolution, and subtract the plane of the fixed one."""
    moving_height, fixed_height = moving.height, fixed.height
    if blur_cells > 0:
        moving_height = blurred_over_gaps(moving_height, blur_cells, of_slopes=fixed.of_slopes)
    elif blur_cells < 0:
        fixed_height = blurred_over_gaps(fixed_height, -blur_cells, of_slopes=moving.of_slopes)
    plane = plane_of(fixed_height)
    rows, columns = plane.shape
    rise = np.array(
        [
            plane.mean(),
            (plane[0, -1] - plane[0, 0]) * columns / (columns - 1),
            (plane[-1, 0] - plane[0, 0]) * rows / (rows - 1),
        ]
    )
    sigma, stated = _relative_sigma(moving, fixed)
    return _Pair(moving_height - plane, fixed_height - plane, rise, sigma, stated, grid.gsd)


def _relative_sigma(moving: Surface, fixed: Surface) -> tuple[FloatArray, float]:
    """Sigma of the difference at each point relative to the most accurate points, at least 1.

    The second value is the sigma of the most accurate points, metres; 0 if none is stated. Sigmas
    vary slowly compared with the displacements searched for: they are taken before the move.
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
    """Return whether another displacement leaves about the same variance as the best one."""
    apart = float(np.hypot(*(other.shift - best.shift))) > APART
    spread, least = (float(np.nanvar(one.residual.standardised)) for one in (other, best))
    return apart and spread < options.ambiguity * least


def _plain(pair: _Pair) -> Fields:
    """The two surfaces without filter."""
    # The SPC surface has the smoother slopes.
    spc = bridged(pair.moving if pair.swapped else pair.fixed)
    level = pair.plane[0] + np.tensordot(pair.plane[1:], tilts(spc.shape), axes=1)
    return Fields(
        bridged(pair.moving),
        pair.moving_known,
        closable(pair.moving_known),
        bridged(pair.fixed),
        pair.fixed_known,
        pair.sigma,
        np.ascontiguousarray(tilt_partials(spc + level, pair.gsd)),
        1.0,
    )


def _whitened(
    plain_fields: Fields, spectrum: NoiseSpectrum, plain: Alignment, search: Search
) -> Alignment | None:
    """Align the surfaces again, filtered so that their difference is white; None if no better.

    The unfiltered alignment is more accurate where gaps leave too few points for the filter, or the
    relief has no short wavelengths.
    """
    moving, fixed, *tilted = spectrum.whitened(
        np.stack([plain_fields.moving, plain_fields.fixed, *plain_fields.tilting])
    )
    fields = Fields(
        moving,
        supported(plain_fields.moving_known),
        supported(plain_fields.moving_near),
        fixed,
        supported(plain_fields.fixed_known),
        plain_fields.sigma,
        np.stack(tilted),
        spectrum.level,
    )
    fine = replace(search, tolerance=_FINE, area=0.0)
    sharp = Aligner.of(fields).align(plain.shift, fine)
    if sharp is None or not sharp.converged or not np.isfinite(sharp.covariance).all():
        return None
    moved = sharp.shift - plain.shift
    apart = moved @ np.linalg.solve(plain.covariance[:2, :2], moved)
    gained = np.trace(sharp.covariance[:2, :2]) < np.trace(plain.covariance[:2, :2])
    return sharp if gained and apart < _OTHER_MINIMUM**2 else None


@dataclass(frozen=True, eq=False)
class _Found:
    """The best alignment, its residual without filter, and alternatives that are about as good."""

    best: Alignment
    residual: Residual
    alternatives: list[Alignment]


def _judged(
    name: str, grid: MapletGrid, pair: _Pair, found: _Found, options: MatchOptions
) -> Match:
    """Convert an alignment to a match, with the reason if it must not be used."""
    local, covariance = _in_metres(pair, found, options)
    residual = found.residual
    match = Match(
        name=name,
        center=grid.center,
        displacement=grid.axes.T @ local,
        covariance=grid.axes.T @ covariance @ grid.axes,
        local=local,
        residual=residual.standardised * pair.sigma * (-1.0 if pair.swapped else 1.0),
        correlation=_correlation(pair, residual),
        coverage=float(np.mean(residual.compared)),
        iterations=found.best.iterations,
        reason="",
        at_lidar=pair.swapped,
    )
    best = found.best
    judged = match.judged(options, converged=best.converged, patches=best.patches)
    if judged.cause is Cause.UNCORRELATED and (
        float(np.nanstd(residual.standardised)) <= _WITHIN_STATED * pair.stated
    ):
        flat = replace(options, min_correlation=-1.0)
        return match.judged(flat, converged=best.converged, patches=best.patches)
    return judged


def _in_metres(pair: _Pair, found: _Found, options: MatchOptions) -> tuple[FloatArray, FloatArray]:
    """Displacement (3,) along the grid's axes, metres, and its covariance.

    Along directions to alternatives the sigma is the capture range.
    """
    best, slope = found.best, pair.plane[1:] / pair.moving.shape[::-1]
    covariance = best.covariance[:3, :3].copy()
    for other in found.alternatives:
        along = other.shift - best.shift
        reach = options.capture_m / pair.gsd
        covariance[:2, :2] += np.outer(along, along) * reach**2 / (along @ along)
    # The subtracted plane has moved too.
    to_metres = np.diag([pair.gsd, pair.gsd, 1.0])
    to_metres[2, :2] = slope
    up = best.plane[0]
    if pair.swapped:
        # The plane refers to the points of the lidar, the middle to those of the SPC surface.
        up += best.plane[1:] @ (best.shift / pair.moving.shape[::-1])
        to_metres = -to_metres
    spread = _positive(to_metres @ covariance @ to_metres.T, _ROUNDING * pair.gsd)
    return to_metres @ np.array([*best.shift, up]), spread


def _positive(covariance: FloatArray, least: float) -> FloatArray:
    """Return a covariance (3, 3) with no sigma below `least` (rounding, for equal surfaces)."""
    if not np.isfinite(covariance).all():
        return covariance
    values, vectors = np.linalg.eigh(covariance)
    if values[0] >= least**2:
        return covariance
    positive: FloatArray = (vectors * np.maximum(values, least**2)) @ vectors.T
    return positive


def _correlation(pair: _Pair, residual: Residual) -> float:
    """Weighted correlation of the two surfaces, planes removed, over the compared points."""
    compared = residual.compared
    rows, columns = pair.sigma.shape
    layers = np.stack(
        [np.ones(compared.shape), *tilts((rows, columns)), pair.fixed, residual.moved]
    )
    rows = np.where(compared, layers / pair.sigma, 0.0).reshape(len(layers), -1)
    both = rows @ rows.T
    product = both[3:, 3:] - both[3:, :3] @ np.linalg.solve(both[:3, :3], both[:3, 3:])
    scale = np.sqrt(product[0, 0] * product[1, 1])
    return float(product[0, 1] / scale) if scale > 0 else 0.0
