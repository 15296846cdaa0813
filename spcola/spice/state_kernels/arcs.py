"""Times of images cut into arcs, and the rates along each."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from spcola.arrays import FloatArray


def arcs(times: FloatArray, max_gap_s: float) -> list[slice]:
    """Return runs of increasing times (N,), s, no two neighbours in one further apart than a gap.

    Parameters
    ----------
    times : (N,) ndarray
    max_gap_s : float
        Longest step within an arc, seconds.
    """
    cuts = np.flatnonzero(np.diff(times) > max_gap_s) + 1
    ends = [0, *cuts.tolist(), len(times)]
    return [slice(low, high) for low, high in pairwise(ends)]


def rates(times: FloatArray, places: FloatArray) -> FloatArray:
    """Return velocities (N, 3) by differences of places (N, 3) along an arc; 0 of a single one."""
    if len(times) == 1:
        return np.zeros_like(places)
    found: FloatArray = np.gradient(places, times, axis=0)
    return found
