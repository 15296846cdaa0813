"""Errors that several observations share: a few patterns, and a residual covariance for each.

The covariance of N observations is ``Σ_k p_k p_kᵀ`` of patterns p_k (of standard deviation 1) plus
one block for each observation. Scans, states of images, landmarks, maplets and the ground differ in
the source of their patterns; their separation and counting are the same, and are done here.
"""

from __future__ import annotations

import numpy as np
from scipy import linalg

from spcola.arrays import FloatArray

SHARED = 1.2
"""A pattern is shared if its variance exceeds that of a single observation (1)."""


def covariance_root(covariance: FloatArray) -> FloatArray:
    """Return R (K, K) with R Rᵀ = `covariance`, of metres and radians."""
    unit = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    return unit[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))


def patterns_of(correlation: FloatArray) -> FloatArray:
    """Return patterns (N, K) of standard deviation 1 that several of N observations share.

    `correlation` (N, N) is that of their errors.
    """
    size, vectors = np.linalg.eigh(correlation)
    kept = size > SHARED
    return vectors[:, kept] * np.sqrt(size[kept])


def own_share(patterns: FloatArray) -> FloatArray:
    """Return the share (N,) of each observation's variance outside its patterns (N, K), 0 to 1."""
    return np.clip(1.0 - np.sum(patterns**2, axis=1), 0.0, 1.0)


def strongest(patterns: FloatArray, *, least: float) -> tuple[FloatArray, FloatArray]:
    """Patterns (N, 3, K) that displace the N places by at least `least` metres, and the rest.

    Parameters
    ----------
    patterns : (N, 3, M) ndarray
        Patterns of standard deviation 1 each, metres.
    least : float
        Root of the sum of squares over all places, metres.

    Returns
    -------
    kept : (N, 3, K) ndarray
        The same errors in uncorrelated patterns, strongest first.
    rest : (N, 3, 3) ndarray
        Covariance of each place due to the patterns left out, square metres.
    """
    count = len(patterns)
    # Spelled out: NumPy cannot infer the length of an axis of an array of size 0.
    flat = patterns.reshape(3 * count, patterns.shape[2])
    if not flat.size:
        return np.zeros((count, 3, 0)), np.zeros((count, 3, 3))
    short = flat.shape[0] < flat.shape[1]
    square, directions = linalg.eigh(flat @ flat.T if short else flat.T @ flat)
    chosen = np.flatnonzero(square > least**2)[::-1]
    if short:
        kept = directions[:, chosen] * np.sqrt(square[chosen])
    else:
        kept = flat @ directions[:, chosen]
    kept = kept.reshape(count, 3, len(chosen))
    whole = np.einsum("nim,njm->nij", patterns, patterns)
    return kept, whole - np.einsum("nik,njk->nij", kept, kept)
