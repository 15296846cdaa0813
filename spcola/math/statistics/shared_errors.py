"""Errors that several observations share: a few patterns, and what each has of its own beside.

The covariance of N observations is ``Σ_k p_k p_kᵀ`` of patterns p_k (of standard deviation 1) plus
one block for each observation. Scans, states of images, landmarks, maplets and the ground differ in
where their patterns come from; how these are parted and counted is the same, and stands here.
"""

from __future__ import annotations

import numpy as np
from scipy import linalg

from spcola.arrays import FloatArray

SHARED = 1.2
"""A pattern of errors is one that observations share if it holds more than a single one's (1)."""


def covariance_root(covariance: FloatArray) -> FloatArray:
    """Return R (K, K) with R Rᵀ = `covariance`, of metres and radians."""
    unit = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    root: FloatArray = unit[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    return root


def patterns_of(correlation: FloatArray) -> FloatArray:
    """Patterns (N, K) of standard deviation 1 that several of N observations share.

    Parameters
    ----------
    correlation : (N, N) ndarray
        Of their errors.
    """
    size, vectors = np.linalg.eigh(correlation)
    kept = size > SHARED
    patterns: FloatArray = vectors[:, kept] * np.sqrt(size[kept])
    return patterns


def own_share(patterns: FloatArray) -> FloatArray:
    """Share (N,) of each observation's variance that its patterns (N, K) leave, 0 to 1."""
    return np.clip(1.0 - np.sum(patterns**2, axis=1), 0.0, 1.0)


def strongest(patterns: FloatArray, *, least: float) -> tuple[FloatArray, FloatArray]:
    """Patterns (N, 3, K) that displace the N places by `least` metres at least, and the rest.

    Parameters
    ----------
    patterns : (N, 3, M) ndarray
        Of standard deviation 1 each, metres.
    least : float
        Root of the sum of squares over all places, metres.

    Returns
    -------
    kept : (N, 3, K) ndarray
        The same errors in patterns that have nothing to do with one another, strongest first.
    rest : (N, 3, 3) ndarray
        Covariance of each place by what is not kept, square metres.
    """
    count = len(patterns)
    # Spelled out: NumPy cannot tell the length of an axis from an array of size 0.
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
