"""Errors of the ground that single shots share: how far they reach, and what they do."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eigh
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from fusion.estimation import MixedFit, Observations
from fusion.scaling.fit.observation import ScaleObservations
from fusion.scaling.geometry.sharing import SHARED
from spcola.arrays import FloatArray, IntArray
from spcola.math.robust import mad

# Distances tried, each this much longer than the one before; the first holds so many pairs.
_LONGER = 1.25
_FEWEST_PAIRS = 25
# Pairs further apart than this many times the longest distance tried tell nothing of it.
_BEYOND = 2.0
# Errors of the ground that reach further than this share of the radius are none of the relief:
# they cannot be told from offsets of the centre and rotations.
_FURTHEST = 0.25
# The shortest distance tried is no smaller a share of the longest.
_SHORTEST = 1e-3
# A correlation of fewer standard deviations than this is chance, whichever distance it is found at.
_SIGNIFICANT = 4.0
# Shots whose pairs are looked at: of more, each so many-th.
_SAMPLE = 4000
# Standardised residuals beyond this are of stray shots.
_CLIPPED = 3.0
# More patterns than this cost time and tell no more of their size; so many nodes carry them.
_MOST_PATTERNS = 160
_MOST_NODES = 1000


@dataclass(frozen=True, eq=False)
class SharedGround:
    """Errors of the surface under single shots.

    Attributes
    ----------
    reach_m : float
        Distance at which errors of heights are correlated by 1/e, metres.
    sigma_m : float
        Expected standard deviation of a height, metres.
    patterns : (N, K) ndarray
        What each shot has of K patterns of standard deviation 1 that several share, metres.
    own : (N,) ndarray
        Variance of what each has beside them, m².
    """

    reach_m: float
    sigma_m: float
    patterns: FloatArray
    own: FloatArray

    def under(self, observations: ScaleObservations) -> ScaleObservations:
        """The shots with errors of heights, which lie along the normal."""
        oblique = np.sum(observations.normal * observations.beam, axis=1) ** 2
        return replace(
            observations,
            ground=observations.normal[:, :, None] * self.patterns[:, None, :],
            covariance=observations.covariance + (self.own / oblique)[:, None, None],
        )


def shared_ground(
    observations: ScaleObservations, equations: Observations, fit: MixedFit
) -> SharedGround | None:
    """Find in the residuals of a fit what shots on the same ground err with together.

    SPC's heights err alike over some distance, and shots denser than that are no witnesses of
    their own. Errors are taken to be correlated by exp(−d/a), with a as the residuals show it,
    and parted into patterns that several shots share, random effects of one size that is
    estimated, and what each has of its own.

    Parameters
    ----------
    observations : ScaleObservations
        Of single shots.
    equations : Observations
        What was fitted: effects of states, of days, and of what the ground was taken for before.
    fit : MixedFit
        Of them; first as if each had a surface of its own.

    Returns
    -------
    SharedGround or None
        The latter where near shots do not err more alike than by chance.
    """
    used = np.flatnonzero(fit.used)
    of_ground = np.einsum("nr,r->n", equations.effects[-1][:, 0], fit.effects[-1])
    residual = fit.conditional[:, 0] + of_ground
    size = float(mad(residual[used]))
    if not size > 0:
        return None
    standard = np.clip(residual / size, -_CLIPPED, _CLIPPED)
    radius = float(np.mean(np.linalg.norm(observations.point, axis=1)))
    chosen = used[:: -(-len(used) // _SAMPLE)]
    reach, share = common_reach(
        observations.point[chosen], standard[chosen], furthest=_FURTHEST * radius
    )
    if not reach > 0:
        return None
    shared = correlated_patterns(observations.point, reach)
    if shared.shape[1] > _MOST_PATTERNS:
        shared = patch_patterns(observations.point, reach)
    if not shared.shape[1]:
        return None
    sigma = size * min(share, 1.0) ** 0.5
    own = sigma**2 * np.clip(1.0 - np.sum(shared**2, axis=1), 0.0, 1.0)
    return SharedGround(reach, sigma, sigma * shared, own)


def common_reach(
    points: FloatArray, standard: FloatArray, *, furthest: float
) -> tuple[float, float]:
    """Distance a over which residuals are alike by c exp(−d/a), and the share c.

    Least squares over the products of all pairs. Products of independent errors are uncorrelated
    and of unit variance, so that c of each a has a known deviation by chance; the a taken is that
    at which c exceeds it by most, which is the one of least squares.

    Parameters
    ----------
    points : (N, 3) ndarray
        Metres.
    standard : (N,) ndarray
        Residuals over their standard deviations.
    furthest : float
        Longest distance tried, metres.

    Returns
    -------
    float, float
        a, metres, and c; both 0 where pairs are not more alike than by chance.
    """
    pairs = cKDTree(points).query_pairs(_BEYOND * furthest, output_type="ndarray")
    if len(pairs) < _FEWEST_PAIRS:
        return 0.0, 0.0
    away = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    products = np.prod(standard[pairs], axis=1) / np.mean(standard**2)
    tried = float(np.partition(away, _FEWEST_PAIRS - 1)[_FEWEST_PAIRS - 1])
    # Shots may lie on one point.
    tried = max(tried, _SHORTEST * furthest)
    best = (0.0, 0.0, _SIGNIFICANT)
    while tried <= furthest:
        expected = np.exp(-away / tried)
        norm, found = float(expected @ expected), float(expected @ products)
        if found / np.sqrt(norm) > best[2]:
            best = (tried, found / norm, found / np.sqrt(norm))
        tried *= _LONGER
    return best[:2]


def correlated_patterns(points: FloatArray, reach: float) -> FloatArray:
    """Patterns (N, K) of errors correlated by exp(−d/a) that several of N points share.

    The correlation is carried by nodes, the means of the points in cubes of half the `reach` a
    (wider, where these are more than a thousand): C ≈ C_pn C_nn⁻¹ C_np (Nyström). Patterns are its
    eigenvectors times the roots of their eigenvalues, of those that hold more than one point.

    Parameters
    ----------
    points : (N, 3) ndarray
        Metres.
    reach : float
        a, metres.
    """
    edge = reach / 2.0
    while len(nodes := _nodes(points, edge)) > _MOST_NODES:
        edge *= _LONGER
    # Eigenvalues here are much alike; numpy's divide and conquer does not always part them.
    between = np.exp(-cdist(nodes, nodes) / reach)
    size, vectors = eigh(between)
    kept = size > 1e-6 * size[-1]
    root = vectors[:, kept] / np.sqrt(size[kept])
    carried = np.exp(-cdist(points, nodes) / reach) @ root
    strength, turn = eigh(carried.T @ carried)
    patterns: FloatArray = carried @ turn[:, strength > SHARED]
    return patterns


def patch_patterns(points: FloatArray, reach: float) -> FloatArray:
    """Patterns (N, K) of what errors correlated by exp(−d/a) have in common on whole patches.

    Where ground is so wide that errors reach nowhere far, cubes that hold many reaches each part
    it into no more patterns than a fit can carry: of the mean of a patch, errors keep the share
    that the mean of their correlations is, and patch errs beside patch as if alone.

    Parameters
    ----------
    points : (N, 3) ndarray
        Metres.
    reach : float
        a, metres.
    """
    edge = 2.0 * reach
    while (cube := _cubes(points, edge)).max() >= _MOST_PATTERNS:
        edge *= _LONGER
    patterns = np.zeros((len(points), cube.max() + 1))
    for number, column in enumerate(patterns.T):
        inside = cube == number
        alike = np.exp(-cdist(points[inside], points[inside]) / reach)
        column[inside] = np.sqrt(alike.mean())
    return patterns


def _nodes(points: FloatArray, edge: float) -> FloatArray:
    """Means (M, 3) of the points (N, 3) in each cube of `edge` metres that holds any."""
    cube = _cubes(points, edge)
    sums = [np.bincount(cube, column) for column in points.T]
    means: FloatArray = np.stack(sums, axis=1) / np.bincount(cube)[:, None]
    return means


def _cubes(points: FloatArray, edge: float) -> IntArray:
    """Which of the cubes of `edge` metres that hold any each of N points lies in, from 0 (N,)."""
    cubes = np.floor(points / edge).astype(np.int64)
    number: IntArray = np.unique(cubes, axis=0, return_inverse=True)[1].ravel()
    return number
