"""Compiled loop that moves returns by interpolated rotations and displacements."""

from __future__ import annotations

import numpy as np

from spcola.arrays import BoolArray, FloatArray
from spcola.compilation import compiled, compiled_inline


@compiled_inline
def _before(times: FloatArray, time: float, last: int) -> int:
    """Number of the interval of `times` that contains `time`, searched from the last one."""
    if times[last] <= time and (last + 2 >= len(times) or time < times[last + 1]):
        return last
    return max(0, min(int(np.searchsorted(times, time, side="right")) - 1, len(times) - 2))


@compiled
def move_points(
    points: FloatArray,
    time: FloatArray,
    turn_time: FloatArray,
    turn: FloatArray,
    shift_time: FloatArray,
    shift: FloatArray,
    max_gap: float,
) -> tuple[FloatArray, BoolArray]:
    """New places (N, 3) of points (N, 3) at times (N,), and which have one (N,); NaN for others.

    Rotation vectors (K, 3) and displacements (M, 3) are given at times (K,) and (M,). No
    displacement is interpolated over more than `max_gap` seconds; it is NaN where the trajectory is
    unchanged.
    """
    moved = np.empty(points.shape)
    kept = np.empty(len(points), dtype=np.bool_)
    at_turn = at_shift = 0
    w = np.zeros(3)
    d = np.zeros(3)
    for n in range(len(points)):
        t = time[n]
        kept[n] = np.isfinite(t)
        if kept[n] and not np.isnan(max_gap):
            at_shift, kept[n] = _shift_at(shift_time, shift, t, max_gap, at_shift, d)
        if not kept[n]:
            moved[n, 0] = moved[n, 1] = moved[n, 2] = np.nan
            continue
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        if len(turn_time):
            at_turn = _turn_at(turn_time, turn, t, at_turn, w)
            square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
            angle = np.sqrt(square)
            # Rodrigues: p + (sin θ / θ) ω × p + ((1 − cos θ) / θ²) ω × (ω × p).
            if angle > 1e-3:
                s, c = np.sin(angle) / angle, (1.0 - np.cos(angle)) / square
            else:
                s, c = 1.0 - square / 6.0, 0.5 - square / 24.0
            u0 = w[1] * z - w[2] * y
            u1 = w[2] * x - w[0] * z
            u2 = w[0] * y - w[1] * x
            x += s * u0 + c * (w[1] * u2 - w[2] * u1)
            y += s * u1 + c * (w[2] * u0 - w[0] * u2)
            z += s * u2 + c * (w[0] * u1 - w[1] * u0)
        moved[n, 0], moved[n, 1], moved[n, 2] = x + d[0], y + d[1], z + d[2]
    return moved, kept


@compiled_inline
def _turn_at(times: FloatArray, turn: FloatArray, time: float, last: int, out: FloatArray) -> int:
    """Write the rotation vector at a time into `out`; it is constant beyond the ends."""
    low = _before(times, time, last)
    share = min(max((time - times[low]) / (times[low + 1] - times[low]), 0.0), 1.0)
    for axis in range(3):
        out[axis] = turn[low, axis] + share * (turn[low + 1, axis] - turn[low, axis])
    return low


@compiled_inline
def _shift_at(
    times: FloatArray, shift: FloatArray, time: float, max_gap: float, last: int, out: FloatArray
) -> tuple[int, bool]:
    """Write the displacement at a time into `out`; return whether it is covered."""
    if len(times) < 2:
        covered = len(times) == 1 and time == times[0]
        if covered:
            out[:] = shift[0]
        return 0, covered and np.isfinite(out.sum())
    low = _before(times, time, last)
    gap = times[low + 1] - times[low]
    share = (time - times[low]) / gap
    # At the time of a state neither the gap next to it nor missing values beyond it matter.
    if share * (1.0 - share) == 0.0:
        out[:] = shift[low + int(share)]
        return low, np.isfinite(out.sum())
    for axis in range(3):
        out[axis] = shift[low, axis] + share * (shift[low + 1, axis] - shift[low, axis])
    return low, 0.0 <= share <= 1.0 and gap <= max_gap and np.isfinite(out.sum())
