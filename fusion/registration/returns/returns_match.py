"""The match of returns to one SPC surface, without a mapola."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from fusion.estimation.verdict import Cause
from fusion.registration.direct import SurfacePair
from fusion.registration.direct.equations import both_slopes
from fusion.registration.returns.return_heights import (
    CloudOfReturns,
    FixedSurface,
    compared,
    height_of_returns,
    relative_weight,
)
from fusion.surfacematch import Match, MatchOptions
from spcola.arrays import BoolArray, FloatArray
from spcola.grids.correlation import independent_patches, shift_variances
from spcola.grids.gaps import filled
from spcola.grids.robust_covariance import huber_scores, robust_covariance
from spcola.math import Affine
from spcola.math.robust import huber_weight, mad

# Displacements further apart than this, cells, count as different solutions.
_APART = 3.0
# Convergence: a step shorter than this, cells, or than this share of its sigma. Returns that change
# cells with every step make the last digits vary.
_STILL, _STILL_SIGMAS = 1e-3, 0.05
# Smallest share of common relief in the squared slopes; below it noise dominates the match.
_LEAST_COMMON = 0.1


def match_returns(
    name: str,
    returns: CloudOfReturns,
    fixed: FixedSurface,
    *,
    options: MatchOptions | None = None,
) -> Match:
    """Find the displacement of returns onto one SPC surface.

    Model, plane and refusals are those of :func:`fusion.surfacematch.match_surfaces`, but at each
    step the returns themselves are moved and compared with the surface at their new positions.

    Parameters
    ----------
    name : str
    returns : CloudOfReturns
        Near the surface.
    fixed : FixedSurface
    options : MatchOptions, optional

    Returns
    -------
    Match
        With NaN displacement and a `reason` if there is no trustworthy match.
    """
    options = options or MatchOptions()
    here = height_of_returns(returns, fixed, _shift(fixed, np.zeros(3)))
    both = float(np.mean(np.isfinite(here.height)))
    if both < options.min_coverage:
        few = f"the returns cover only {both:.0%} of the surface"
        return Match.failed(name, fixed.grid, both, Cause.NOT_COVERED, few)
    starts = _searched(here.height, fixed, relative_weight(here, fixed.surface), options)
    if not starts:
        edge = f"the best match lies at the edge of the capture range ({options.capture_m:g} m)"
        return Match.failed(name, fixed.grid, both, Cause.CAPTURE_RANGE, edge)
    found = [_refined(returns, fixed, start, options) for start in starts]
    best = found[0]
    if best is None:
        return Match.failed(name, fixed.grid, both, Cause.NO_RELIEF, Cause.NO_RELIEF.meaning)
    for other in found[1:]:
        if other is not None and _is_alternative(other, best, fixed.grid.gsd, options):
            flat = f"{Cause.AMBIGUOUS.meaning} (flat or periodic terrain)"
            return Match.failed(name, fixed.grid, both, Cause.AMBIGUOUS, flat)
    return _judged(name, fixed, best, options)


def _shift(fixed: FixedSurface, local: FloatArray) -> Affine:
    """Displacement by `local` (3,), metres along the grid's axes."""
    return Affine(np.eye(3), fixed.grid.axes.T @ local, "spc", "lidar")


def _searched(
    height: FloatArray, fixed: FixedSurface, weight: FloatArray, options: MatchOptions
) -> list[FloatArray]:
    """Best whole-cell displacement, metres, and up to two others; none if it lies on the edge."""
    gsd = fixed.grid.gsd
    reach = max(1, int(np.ceil(options.capture_m / gsd)))
    covered = np.isfinite(height)
    # Gaps of the returns move with them: the weight there must not be 0.
    weights = np.where(fixed.known, np.where(covered, weight, np.median(weight[covered])), 0.0)
    variance = shift_variances(filled(height), covered, filled(fixed.height), weights, reach=reach)
    valleys = np.argwhere(ndimage.minimum_filter(variance, size=5, mode="nearest") == variance)
    order = sorted(valleys.tolist(), key=lambda at: float(variance[at[0], at[1]]))
    best = order[0]
    if reach > 1 and max(abs(best[0] - reach), abs(best[1] - reach)) == reach:
        return []
    limit = max(
        options.ambiguity * float(variance[best[0], best[1]]), 0.25 * float(np.nanmedian(variance))
    )
    chosen = [
        (row, column)
        for row, column in order
        if np.hypot(row - best[0], column - best[1]) > _APART and variance[row, column] < limit
    ]
    up = float(np.nanmedian(fixed.height - height))
    return [
        np.array([gsd * (column - reach), gsd * (row - reach), up])
        for row, column in [(best[0], best[1]), *chosen[:2]]
    ]


@dataclass(frozen=True, eq=False)
class _Fine:
    local: FloatArray  # metres
    covariance: FloatArray  # of it
    standardised: FloatArray
    pair: SurfacePair
    iterations: int
    converged: bool


def _refined(
    returns: CloudOfReturns, fixed: FixedSurface, start: FloatArray, options: MatchOptions
) -> _Fine | None:
    """Gauss–Newton from `start`; None if the relief does not determine a displacement."""
    gsd, local = fixed.grid.gsd, start.copy()
    iterations, converged = 0, False
    while not converged and iterations < options.max_iterations:
        iterations += 1
        lidar = height_of_returns(returns, fixed, _shift(fixed, local))
        if np.count_nonzero(np.isfinite(lidar.height)) < 30:
            return None
        pair = compared(lidar, fixed)
        solved = _solved(pair, gsd)
        if solved is None:
            return None
        step, rest, covariance = solved
        length = float(np.max(np.abs(step[:2]))) / gsd
        local = local + step[:3] / max(length, 1.0)
        sigma = float(np.sqrt(np.min(np.diag(covariance)[:2]))) / gsd
        converged = length < max(_STILL, _STILL_SIGMAS * sigma)
    return _Fine(local, covariance, rest, pair, iterations, converged)


def _solved(pair: SurfacePair, gsd: float) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Step (5,), standardised residual (N, N), and covariance (3, 3) of a displacement.

    The last two parameters, tilts of a plane, are nuisance parameters.
    """
    slopes = both_slopes(pair, gsd)
    size = len(pair.fixed)
    tilt_y, tilt_x = (np.indices(pair.fixed.shape) - (size - 1) / 2.0) / size
    # Points above the middle move with a tilt: see fusion.surfacematch.alignment.tilt_partials.
    arm = pair.fixed / (size * gsd)
    sides = [
        np.stack([-x, -y, np.ones_like(arm), tilt_x + arm * x, tilt_y + arm * y], axis=-1)
        for x, y in (slopes[:2], slopes[2:])
    ]
    difference = pair.fixed - pair.moving
    known = np.isfinite(difference + slopes.sum(axis=0)) & (pair.weight > 0)
    if np.count_nonzero(known) < 30:
        return None
    root = np.sqrt(np.where(known, pair.weight, 0.0))
    first, second = (np.nan_to_num(side) * root[..., None] for side in sides)
    mean, target = 0.5 * (first + second), np.nan_to_num(difference) * root
    robust, step = np.where(known, pair.robust, 0.0), np.zeros(5)
    for _ in range(4):
        weighted = mean * robust[..., None]
        noisy = np.einsum("rcp,rcq->pq", weighted, mean)
        normal = np.einsum("rcp,rcq->pq", first * robust[..., None], second)
        normal = 0.5 * (normal + normal.T)
        if not _determined(noisy, normal):
            return None
        step = np.linalg.solve(normal, np.einsum("rcp,rc->p", weighted, target))
        rest = target - mean @ step
        spread = max(float(mad(rest[known])), 1e-12)
        robust = np.where(known, huber_weight(rest / spread), 0.0)
    standardised = np.where(known, rest, np.nan)
    # The sandwich uses `noisy`, which includes noise of the slopes, in place of `normal`.
    response = np.linalg.solve(normal, noisy)
    design = np.moveaxis(np.where(known[..., None], mean, 0.0), -1, 0)
    found = robust_covariance(design, huber_scores(standardised, spread))
    covariance = response @ found.matrix @ response.T
    return step, standardised, covariance[:3, :3]


def _determined(noisy: FloatArray, normal: FloatArray) -> bool:
    """Return whether relief common to both surfaces, not noise, determines every parameter."""
    size = np.sqrt(np.diag(noisy))
    if np.min(size) < 1e-9:
        return False
    values, vectors = np.linalg.eigh(noisy / np.outer(size, size))
    if values[0] < 1e-10 * values[-1]:
        return False
    white = vectors / np.sqrt(values) / size[:, None]
    return bool(np.linalg.eigvalsh(white.T @ normal @ white)[0] > _LEAST_COMMON)


def _is_alternative(other: _Fine, best: _Fine, gsd: float, options: MatchOptions) -> bool:
    """Return whether another displacement leaves about the same variance as the best one.

    In square metres, as each pair's weights have their own scale.
    """
    apart = float(np.hypot(*(other.local - best.local)[:2])) > _APART * gsd
    spread, least = (
        float(np.nanvar(np.where(fine.pair.weight > 0, fine.pair.fixed - fine.pair.moving, np.nan)))
        for fine in (other, best)
    )
    return apart and spread < options.ambiguity * least


def _judged(name: str, fixed: FixedSurface, fine: _Fine, options: MatchOptions) -> Match:
    """Convert a refined displacement to a match, with the reason if it must not be used."""
    grid, pair = fixed.grid, fine.pair
    known = np.isfinite(fine.standardised)
    match = Match(
        name=name,
        center=grid.center,
        displacement=grid.axes.T @ fine.local,
        covariance=grid.axes.T @ fine.covariance @ grid.axes,
        local=fine.local,
        residual=np.where(known, pair.fixed - pair.moving, np.nan),
        correlation=_correlation(pair, known),
        coverage=float(np.mean(known)),
        iterations=fine.iterations,
        reason="",
    )
    patches = independent_patches(fine.standardised)
    return match.judged(options, converged=fine.converged, patches=patches)


def _correlation(pair: SurfacePair, known: BoolArray) -> float:
    """Weighted correlation of both surfaces, planes removed, over the points compared."""
    rows, columns = np.nonzero(known)
    share = np.sqrt(pair.weight[known])[:, None]
    plane = share * np.stack([np.ones(len(rows)), rows, columns], axis=1)
    both = share * np.stack([pair.fixed[known], pair.moving[known]], axis=1)
    rest = both - plane @ np.linalg.lstsq(plane, both, rcond=None)[0]
    product = rest.T @ rest
    scale = np.sqrt(product[0, 0] * product[1, 1])
    return float(product[0, 1] / scale) if scale > 0 else 0.0
