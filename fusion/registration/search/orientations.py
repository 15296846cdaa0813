"""Orientations in which one surface fits another: a search over all, then refinement."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from fusion.registration.search.directions import cell_of
from spcola.arrays import FloatArray, IntArray
from spcola.compilation import compiled

MIRROR = np.diag([1.0, 1.0, -1.0])
"""Every mirrored orientation is a rotation of this one."""

# Smallest relative difference of radii that is resolved.
_FLOOR = 1e-4
_LEAST_CELLS = 20
_STEPS_DEG = (5.0, 4.0, 3.0, 2.0, 2.0, 1.0, 1.0)
# Number of best orientations considered for each distinct one that is returned.
_CONSIDERED = 30


def all_orientations(count: int) -> FloatArray:
    """Return evenly distributed rotations and as many mirrored ones (2 `count`, 3, 3).

    Super-Fibonacci spirals (Alexa, CVPR 2022); the 48 orientations along the axes come first.
    """
    s = np.arange(count) + 0.5
    t = s / count
    alpha = 2.0 * np.pi * s / np.sqrt(2.0)
    beta = 2.0 * np.pi * s / 1.533751168755204288118041
    r, q = np.sqrt(t), np.sqrt(1.0 - t)
    spiral = np.stack([r * np.sin(alpha), r * np.cos(alpha), q * np.sin(beta), q * np.cos(beta)], 1)
    along = Rotation.create_group("O").as_matrix()
    turns = np.concatenate([along, Rotation.from_quat(spiral).as_matrix()])
    return np.concatenate([turns, turns @ MIRROR])


def apart_deg(one: FloatArray, others: FloatArray) -> FloatArray:
    """Angles (K,) between an orientation (3, 3) and others (K, 3, 3), degrees.

    Infinite between a mirrored and a proper orientation.
    """
    traces = np.einsum("ij,kij->k", one, others)
    like = np.linalg.det(one) * np.linalg.det(others) > 0.0
    # For two mirrored orientations the product is a rotation as well.
    angle = np.degrees(np.arccos(np.clip((traces - 1.0) / 2.0, -1.0, 1.0)))
    return np.where(like, angle, np.inf)


def distinct(matrices: FloatArray, score: FloatArray, least_deg: float, most: int) -> IntArray:
    """Return the best (at most `most`) orientations at least `least_deg` from any better one."""
    order = np.argsort(-score, kind="stable")[: _CONSIDERED * most]
    order = order[np.isfinite(score[order])]
    ranked, mirrored = matrices[order], np.linalg.det(matrices[order]) < 0.0
    near = 1.0 + 2.0 * np.cos(np.radians(least_deg))
    free = np.ones(len(order), dtype=bool)
    chosen: list[int] = []
    for k in range(len(order)):
        if free[k] and len(chosen) < most:
            chosen.append(k)
            traces = ranked[k:].reshape(-1, 9) @ ranked[k].ravel()
            free[k:] &= (traces < near) | (mirrored[k:] != mirrored[k])
    return order[chosen]


def likeness(
    matrices: FloatArray,
    units: FloatArray,
    log_radius: FloatArray,
    surface: FloatArray,
    factors: Sequence[float],
) -> FloatArray:
    """Return how well a surface fits another in each of many orientations (K,).

    ``n/2 ln((var a + var b) / var(a − b))`` of the log radii a and b in the n directions known in
    both: 0 for unrelated surfaces. The ratio of the mean radii may be one of `factors` within 25 %;
    −inf if it is not, or too few directions are common.

    Parameters
    ----------
    matrices : (K, 3, 3) ndarray
        Orientations applied to the first surface.
    units, log_radius : (N, 3) and (N,) ndarrays
        Directions and log radii of the first surface.
    surface : (6 n²,) ndarray
        Log radii of the second in cells; NaN where unknown.
    factors : sequence of float
        Possible scale factors of the first surface.
    """
    n = round(np.sqrt(len(surface) / 6.0))
    middle = float(np.nanmean(surface)), float(np.mean(log_radius))
    count, a, b, aa, bb, ab = _moments(
        matrices, units, log_radius - middle[1], surface - middle[0], n
    ).T
    with np.errstate(invalid="ignore", divide="ignore"):
        mean_a, mean_b = a / count, b / count
        var_a, var_b = aa / count - mean_a**2, bb / count - mean_b**2
        both = var_a + var_b
        rest = both - 2.0 * (ab / count - mean_a * mean_b) + _FLOOR**2
        score = 0.5 * count * np.log((both + _FLOOR**2) / rest)
        factor = mean_b + middle[0] - mean_a - middle[1]
        off = np.abs(factor[:, None] - np.log(np.asarray(factors))).min(axis=1)
    score[~((off < np.log(1.25)) & (count >= _LEAST_CELLS))] = -np.inf
    return score


def refined(
    matrices: FloatArray,
    units: FloatArray,
    log_radius: FloatArray,
    surface: FloatArray,
    factors: Sequence[float],
) -> tuple[FloatArray, FloatArray]:
    """Refine each orientation by ever smaller rotations; return them with their likeness."""
    best = matrices.copy()
    score = likeness(best, units, log_radius, surface, factors)
    for step in _STEPS_DEG:
        turns = Rotation.from_rotvec(np.radians(step) * _around()).as_matrix()
        tried = np.einsum("tij,kjl->ktil", turns, best)
        values = likeness(tried.reshape(-1, 3, 3), units, log_radius, surface, factors).reshape(
            len(best), len(turns)
        )
        which = values.argmax(axis=1)
        found = values[np.arange(len(best)), which]
        better = found > score
        best[better] = tried[better, which[better]]
        score[better] = found[better]
    return best, score


def _around() -> FloatArray:
    """Rotation vectors (26, 3) to all neighbours of the middle of a cube of 3 × 3 × 3."""
    steps = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return steps[np.any(steps != 0.0, axis=1)]


@compiled
def _moments(
    matrices: FloatArray, units: FloatArray, first: FloatArray, surface: FloatArray, n: int
) -> FloatArray:
    """Count, sums, and sums of squares and products (K, 6) over the common directions."""
    moments = np.zeros((len(matrices), 6))
    for k in range(len(matrices)):
        m = matrices[k]
        m00, m01, m02 = m[0, 0], m[0, 1], m[0, 2]
        m10, m11, m12 = m[1, 0], m[1, 1], m[1, 2]
        m20, m21, m22 = m[2, 0], m[2, 1], m[2, 2]
        count, a, b, aa, bb, ab = 0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(len(units)):
            x, y, z = units[i, 0], units[i, 1], units[i, 2]
            there = surface[
                cell_of(
                    m00 * x + m01 * y + m02 * z,
                    m10 * x + m11 * y + m12 * z,
                    m20 * x + m21 * y + m22 * z,
                    n,
                )
            ]
            if not np.isnan(there):
                here = first[i]
                count += 1
                a += here
                b += there
                aa += here * here
                bb += there * there
                ab += here * there
        moments[k, 0], moments[k, 1], moments[k, 2] = count, a, b
        moments[k, 3], moments[k, 4], moments[k, 5] = aa, bb, ab
    return moments
