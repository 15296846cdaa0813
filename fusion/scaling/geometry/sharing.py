"""Shared errors of pairs by errors of the SPC surface."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spcola.arrays import FloatArray
from spcola.grids import Maplet, MapletGrid
from spcola.math.statistics import own_share, patterns_of

# Patterns that displace the observations by less than this (root of the sum of squares, metres) are
# negligible compared with the error of one pair.
_LEAST_M = 5e-3


def maplet_shares(grid: MapletGrid, height: FloatArray, maplets: Sequence[Maplet]) -> FloatArray:
    """Share (M,) of each of M maplets in a bigmap's heights, by number of points and GSD.

    Parameters
    ----------
    grid : MapletGrid
        Of the bigmap.
    height : (2q+1, 2q+1) ndarray
        Of the bigmap, metres; NaN where unknown.
    maplets : sequence of Maplet

    Returns
    -------
    (M,) ndarray
        Their sum is 1, or 0 if the bigmap is empty.
    """
    points = grid.points(height)[np.isfinite(height)]
    weights = np.zeros((len(maplets), len(points)))
    for row, maplet in zip(weights, maplets, strict=True):
        x, y, _ = maplet.grid.project(points)
        q = maplet.grid.half_size
        m, n = (np.rint(each).astype(np.intp) + q for each in (y, x))
        inside = (m >= 0) & (m <= 2 * q) & (n >= 0) & (n <= 2 * q)
        row[inside] = maplet.valid[m[inside], n[inside]] / (grid.gsd**2 + maplet.grid.gsd**2)
    total = weights.sum(axis=0)
    reached = total > 0
    count = max(int(np.count_nonzero(reached)), 1)
    shares: FloatArray = np.sum(weights[:, reached] / total[reached], axis=1) / count
    return shares


def ground_in_common(grids: Sequence[MapletGrid]) -> FloatArray:
    """Share (N, N) of the ground that each of N squares has in common with each other one.

    For squares of one size in about the same plane: ``(1 − |Δx|/L) (1 − |Δy|/L)``, which is the
    correlation of means over them.
    """
    count = len(grids)
    common = np.eye(count)
    for i, grid in enumerate(grids):
        others = grids[i + 1 :]
        if not others:
            break
        x, y, _ = grid.project(np.array([other.center for other in others]))
        side = 2.0 * grid.half_size + 1.0
        share = np.clip(1.0 - np.abs(x) / side, 0.0, 1.0) * np.clip(
            1.0 - np.abs(y) / side, 0.0, 1.0
        )
        share[np.array([other.uz @ grid.uz for other in others]) < 0.5] = 0.0
        common[i, i + 1 :] = common[i + 1 :, i] = share
    return common


def patterns(displaced: FloatArray, size: float = 1.0) -> FloatArray:
    """Combine sources of error to fewer patterns of (nearly) the same covariance.

    Parameters
    ----------
    displaced : (N, 3, R) ndarray
        Displacement of each observation by each of R independent sources.
    size : float
        Expected standard deviation of a source; times it `displaced` is in metres.

    Returns
    -------
    (N, 3, K) ndarray
        Displacements by K ≤ R patterns, negligible ones left out.
    """
    # Not by `strongest`: its rounding moves the sizes of errors that are sought with the patterns,
    # and through them the residuals of pairs by micrometres.
    rows = displaced.reshape(3 * len(displaced), -1)
    left, strength, _ = np.linalg.svd(rows, full_matrices=False)
    kept = strength * size > _LEAST_M
    return (left[:, kept] * strength[kept]).reshape(len(displaced), 3, -1)


def shared_matches(common: FloatArray, covariances: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Decompose the errors of matches into shared patterns and residual covariances.

    Errors of a match are mostly those of the SPC heights, which other matches over the same ground
    share. The covariance of the errors of pairs i and j is ρ_ij √C_i √C_jᵀ, with their share of
    common ground ρ_ij.

    Parameters
    ----------
    common : (N, N) ndarray
        ρ: see :func:`ground_in_common`.
    covariances : (N, 3, 3) ndarray
        C, of the single matches, m².

    Returns
    -------
    (N, 3, K) ndarray, (N, 3, 3) ndarray
        Displacements by patterns of standard deviation 1, metres; covariances of the rest, m².
    """
    strength = patterns_of(common)
    values, axes = np.linalg.eigh(covariances)
    root = np.einsum("nij,nj,nkj->nik", axes, np.sqrt(np.maximum(values, 0.0)), axes)
    displaced = np.einsum("nk,nij->nikj", strength, root).reshape(len(root), 3, -1)
    return displaced, own_share(strength)[:, None, None] * covariances
