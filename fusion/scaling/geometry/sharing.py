"""What errors of the SPC surface do to many pairs at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spcola.arrays import FloatArray
from spcola.grids import Maplet, MapletGrid
from spcola.math.statistics import own_share, patterns_of, strongest

# Patterns that displace the observations by less than this, root of the sum of squares, metres, are
# nothing beside what one pair tells.
_LEAST_M = 5e-3


def maplet_shares(grid: MapletGrid, height: FloatArray, maplets: Sequence[Maplet]) -> FloatArray:
    """Share (M,) that each of M maplets has in a bigmap's heights, by number of points and GSD.

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
        Their sum is 1, or 0 where the bigmap holds nothing.
    """
    points = grid.points(height)[np.isfinite(height)]
    held = np.zeros((len(maplets), len(points)))
    for row, maplet in zip(held, maplets, strict=True):
        x, y, _ = maplet.grid.project(points)
        q = maplet.grid.half_size
        m, n = (np.rint(each).astype(np.intp) + q for each in (y, x))
        inside = (m >= 0) & (m <= 2 * q) & (n >= 0) & (n <= 2 * q)
        row[inside] = maplet.valid[m[inside], n[inside]] / (grid.gsd**2 + maplet.grid.gsd**2)
    total = held.sum(axis=0)
    reached = total > 0
    count = max(int(np.count_nonzero(reached)), 1)
    shares: FloatArray = np.sum(held[:, reached] / total[reached], axis=1) / count
    return shares


def ground_in_common(grids: Sequence[MapletGrid]) -> FloatArray:
    """Share (N, N) of its ground that each of N squares has in common with each other one.

    Of squares of one size in much the same plane: ``(1 − |Δx|/L) (1 − |Δy|/L)``, which is the
    correlation of what is averaged over them.
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
    """Combine sources of error that observations can hardly tell apart.

    Parameters
    ----------
    displaced : (N, 3, R) ndarray
        What each of R independent sources does to each observation.
    size : float
        Expected standard deviation of a source, by which the result is in metres.

    Returns
    -------
    (N, 3, K) ndarray
        With K ≤ R sources that together do the same, but for what is too small to matter.
    """
    least = _LEAST_M / size if size > 0 else np.inf
    return strongest(displaced, least=least)[0]


def shared_matches(common: FloatArray, covariances: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Part the errors of matches into patterns that pairs share and what each has of its own.

    What one match does not know is mostly the SPC heights under it, and another match over the
    same ground knows them no better. The errors of pairs i and j are taken to be correlated by the
    ground that they have in common, ρ_ij √C_i √C_jᵀ.

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
