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


def padded(
    times: FloatArray, places: FloatArray, velocity: FloatArray, pad_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return an arc with one more state `pad_s` seconds before and after it, on a straight line."""
    return (
        np.concatenate([[times[0] - pad_s], times, [times[-1] + pad_s]]),
        np.concatenate(
            [[places[0] - pad_s * velocity[0]], places, [places[-1] + pad_s * velocity[-1]]]
        ),
        np.concatenate([velocity[:1], velocity, velocity[-1:]]),
    )


def half_widths(times: FloatArray, most_s: float) -> FloatArray:
    """Return half of the interval (N,), s, around each time that touches no other's."""
    steps = np.diff(times)
    near = np.minimum(np.append(steps, np.inf), np.append(np.inf, steps))
    return np.minimum(most_s, 0.4 * near)
