"""Shared errors of the SPC surface under single shots: correlation length and patterns."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky, eigh, solve_triangular
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from fusion.estimation import MixedFit, Observations
from fusion.scaling.fit.observation import ScaleObservations
from spcola.arrays import FloatArray, IntArray
from spcola.math.robust import mad
from spcola.math.statistics import SHARED, own_share

# Ratio of successive correlation lengths tried; number of pairs within the first.
_LONGER = 1.25
_FEWEST_PAIRS = 25
# Pairs up to this many times the longest correlation length are used.
_BEYOND = 2.0
# Longest correlation length, as a share of the radius: longer ones are not separable from offsets
# of the centre and rotations.
_FURTHEST = 0.25
# Shortest correlation length tried, as a share of the longest.
_SHORTEST = 1e-3
# Smallest significant correlation, in standard deviations, over all lengths tried.
_SIGNIFICANT = 4.0
# Largest number of shots whose pairs are used.
_SAMPLE = 4000
# Standardised residuals are clipped here, so that outliers do not dominate.
_CLIPPED = 3.0
# Largest numbers of patterns and of nodes: more cost time and hardly improve the estimate.
_MOST_PATTERNS = 160
_MOST_NODES = 1000
# Variance, relative, that nodes have each of their own.
_APART = 1e-9


@dataclass(frozen=True, eq=False)
class SharedGround:
    """Errors of the surface heights under N single shots.

    Attributes
    ----------
    reach_m : float
        Correlation length of height errors (1/e), metres.
    sigma_m : float
        Expected standard deviation of a height, metres.
    patterns : (N, K) ndarray
        Height errors of the shots by K shared patterns of standard deviation 1, metres.
    own : (N,) ndarray
        Residual variance of each, m².
    """

    reach_m: float
    sigma_m: float
    patterns: FloatArray
    own: FloatArray

    def added_to(self, observations: ScaleObservations) -> ScaleObservations:
        """Return the shots with these errors of heights added."""
        oblique = np.sum(observations.normal * observations.beam, axis=1) ** 2
        return replace(
            observations,
            ground=observations.normal[:, :, None] * self.patterns[:, None, :],
            covariance=observations.covariance + (self.own / oblique)[:, None, None],
        )


def shared_ground(
    observations: ScaleObservations, equations: Observations, fit: MixedFit
) -> SharedGround | None:
    """Estimate the shared errors of shots on the same ground from the residuals of a fit.

    Errors of SPC heights are correlated over some distance, so that denser shots are not
    independent. The correlation exp(−d/a), with a estimated from the residuals, is decomposed into
    shared patterns, random effects of one estimated size, and a residual variance of each shot.

    Parameters
    ----------
    observations : ScaleObservations
        Of single shots.
    equations : Observations
        Observations of the fit, with effects of states, days and ground.
    fit : MixedFit
        Fit to them, in the first round without effects of the ground.

    Returns
    -------
    SharedGround or None
        None if residuals of neighbouring shots are not significantly correlated.
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
    return SharedGround(reach, sigma, sigma * shared, sigma**2 * own_share(shared))


def common_reach(
    points: FloatArray, standard: FloatArray, *, furthest: float
) -> tuple[float, float]:
    """Fit the correlation c exp(−d/a) of residuals: correlation length a and amplitude c.

    By least squares over the products of all pairs. Products of independent errors are uncorrelated
    and of unit variance, which gives the sigma of c for each a; the best a is that of the largest
    ratio of c to its sigma, which is also that of least squares.

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
        a, metres, and c; both 0 if the correlation is not significant.
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
    """Shared patterns (N, K) of errors at N points with correlation exp(−d/a).

    The correlation is approximated by nodes, the means of the points in cubes of half the `reach` a
    (wider if these are more than a thousand): C ≈ C_pn C_nn⁻¹ C_np (Nyström). Patterns are its
    eigenvectors times the roots of their eigenvalues, for eigenvalues of more than about one point.

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
    # Nodes may lie so close together that rounding makes the matrix singular.
    between = np.exp(-cdist(nodes, nodes) / reach) + _APART * np.eye(len(nodes))
    carried = solve_triangular(
        cholesky(between, lower=True), np.exp(-cdist(nodes, points) / reach), lower=True
    ).T
    # Many eigenvalues are nearly equal; numpy's divide and conquer does not always converge.
    _, turn = eigh(carried.T @ carried, subset_by_value=(SHARED, np.inf))
    patterns: FloatArray = carried @ turn
    return patterns


def patch_patterns(points: FloatArray, reach: float) -> FloatArray:
    """Shared patterns (N, K) of errors with correlation exp(−d/a), one for each of K patches.

    For ground that is wide compared with the `reach` a: cubes of many correlation lengths limit the
    number of patterns. The variance of a patch's mean is the mean of the correlations within it;
    different patches are assumed independent.

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
        correlation = np.exp(-cdist(points[inside], points[inside]) / reach)
        column[inside] = np.sqrt(correlation.mean())
    return patterns


def _nodes(points: FloatArray, edge: float) -> FloatArray:
    """Means (M, 3) of the points (N, 3) in each occupied cube of `edge` metres."""
    cube = _cubes(points, edge)
    sums = [np.bincount(cube, column) for column in points.T]
    means: FloatArray = np.stack(sums, axis=1) / np.bincount(cube)[:, None]
    return means


def _cubes(points: FloatArray, edge: float) -> IntArray:
    """Number (N,), from 0, of the occupied cube of `edge` metres of each point."""
    cubes = np.floor(points / edge).astype(np.int64)
    number: IntArray = np.unique(cubes, axis=0, return_inverse=True)[1].ravel()
    return number
