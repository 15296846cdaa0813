"""The first hits of rays on the synthetic body.

Rays are followed many at a time: all that are still under way are looked at together, so that the
roughness, most of the work, is computed for several directions at once.
"""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray, IntArray
from spcola.kernel import kernel
from spcola.truth.bounds import Bounds, fly
from spcola.truth.surface import BLOCK, Surface, block_radii

# Tangent of a slope that no ground in the way of a ray exceeds for long: boulders' sides.
_STEEPEST = 2.1
_LEAST_STEP = 0.02
_ON_SURFACE = 1e-11
_MOST_LOOKS = 20_000

# What is kept of a ray under way: where it is and ends and began, the last place above the
# ground and the first below it with the clearances there, which of the two stayed last, and how
# often it was looked at. Distances are from the foot (the point of the ray next to O): of the
# size of the body, not of the range.
_T, _END, _START, _ABOVE, _F_ABOVE, _BELOW, _F_BELOW, _SIDE, _LOOKS = range(9)


@kernel
def _begin(
    surface: Surface, bounds: Bounds, ray: tuple[FloatArray, FloatArray, FloatArray], ceiling: float
) -> tuple[float, float, float]:
    """Return where a ray is to be looked at first, where it ends, and where it began.

    The first is not before the end for a ray that misses. `ray` is origin, direction and foot.
    """
    origin, beam, foot = ray
    closest = -(origin[0] * beam[0] + origin[1] * beam[1] + origin[2] * beam[2])
    square = ceiling * ceiling
    for axis in range(3):
        foot[axis] = origin[axis] + closest * beam[axis]
        square -= foot[axis] * foot[axis]
    if square <= 0.0:
        return 0.0, 0.0, 0.0
    end = np.sqrt(square)
    start = max(-end, -closest)
    return fly(surface, bounds, foot, beam, (start, end)), end, start


@kernel
def _march(
    surface: Surface, bounds: Bounds, ray: tuple[FloatArray, FloatArray], state: FloatArray
) -> float:
    """Return the next place of a ray that is above the ground, by at least as far as is safe.

    The ground, with slopes up to the steepest, cannot come to meet it within the step; near the
    ground it leaps to where the last two looks say that it is.
    """
    foot, beam = ray
    t, height = state[_T], state[_F_ABOVE]
    x, y, z = foot[0] + t * beam[0], foot[1] + t * beam[1], foot[2] + t * beam[2]
    cosine = -(x * beam[0] + y * beam[1] + z * beam[2]) / np.sqrt(x * x + y * y + z * z)
    rate = max(0.3, cosine + _STEEPEST * np.sqrt(max(0.0, 1.0 - cosine * cosine)))
    step = max(height / rate, _LEAST_STEP)
    fall = state[_F_BELOW]
    if fall > 0.0 and height / fall < bounds.leap:
        step = max(step, 1.02 * height / fall + 1e-4)
    return fly(surface, bounds, foot, beam, (t + step, state[_END]))


@kernel
def _narrow(state: FloatArray) -> float:
    """Return where to look next between the places above and below the ground.

    Regula falsi in the Illinois form; every eighth step bisects, so that a kink cannot stall it.
    """
    above, below = state[_ABOVE], state[_BELOW]
    if state[_LOOKS] % 8 == 7:
        return 0.5 * (above + below)
    return above + (below - above) * state[_F_ABOVE] / (state[_F_ABOVE] - state[_F_BELOW])


@kernel
def _bracket(state: FloatArray, value: float) -> None:
    """Take a clearance between the two places into account."""
    if value > 0.0:
        state[_ABOVE], state[_F_ABOVE] = state[_T], value
        state[_F_BELOW] *= 0.5 if state[_SIDE] == 1.0 else 1.0
        state[_SIDE] = 1.0
    else:
        state[_BELOW], state[_F_BELOW] = state[_T], value
        state[_F_ABOVE] *= 0.5 if state[_SIDE] == -1.0 else 1.0
        state[_SIDE] = -1.0


@kernel
def _advance(
    surface: Surface,
    bounds: Bounds,
    ray: tuple[FloatArray, FloatArray],
    state: FloatArray,
    value: float,
) -> bool:
    """Move a ray on by what is known of the clearance `value` where it is.

    Returns whether it is to be looked at again; if not, it hit at ``state[_T]`` (NaN: it missed).
    Until the ground is crossed ``state[_F_BELOW]`` holds how fast the clearance falls, ≥ 0.
    """
    state[_LOOKS] += 1.0
    if state[_F_BELOW] < 0.0:
        _bracket(state, value)
        narrow = state[_BELOW] - state[_ABOVE] < _ON_SURFACE
        if narrow or abs(value) < _ON_SURFACE:
            return False
        state[_T] = _narrow(state)
        return True
    if value > 0.0:
        if state[_F_ABOVE] > 0.0:
            fall = (state[_F_ABOVE] - value) / (state[_T] - state[_ABOVE])
            state[_F_BELOW] = max(0.0, fall)
        state[_ABOVE], state[_F_ABOVE] = state[_T], value
        state[_T] = _march(surface, bounds, ray, state)
    elif state[_F_ABOVE] > 0.0:
        state[_BELOW], state[_F_BELOW], state[_LOOKS] = state[_T], min(value, -1e-300), 0.0
        state[_T] = _narrow(state)
    elif state[_T] > state[_START]:
        # It flew too far, over ground steeper than the bounds allow for.
        state[_T] = max(state[_START], state[_T] + 3.0 * value - 0.1)
    else:
        # A ray that begins below the ground has nothing to hit.
        state[_T] = np.nan
    if not state[_T] < state[_END] or state[_LOOKS] > _MOST_LOOKS:
        state[_T] = np.nan
    return not np.isnan(state[_T])


@kernel
def _look(
    surface: Surface,
    rays: tuple[FloatArray, FloatArray, FloatArray],
    under_way: IntArray,
    scratch: tuple[FloatArray, FloatArray, FloatArray],
    clear: FloatArray,
) -> None:
    """Fill `clear` with the height over the ground of each ray that is `under_way`."""
    feet, beams, states = rays
    directions, radius, block = scratch
    count = len(under_way)
    for j in range(count):
        i = under_way[j]
        t = states[i, _T]
        x = feet[i, 0] + t * beams[i, 0]
        y = feet[i, 1] + t * beams[i, 1]
        z = feet[i, 2] + t * beams[i, 2]
        length = np.sqrt(x * x + y * y + z * z)
        clear[j] = length
        directions[j, 0], directions[j, 1], directions[j, 2] = x / length, y / length, z / length
    block_radii(surface, directions[:count], radius[:count], block)
    for j in range(count):
        clear[j] -= radius[j]


@kernel
def _trace(
    surface: Surface,
    bounds: Bounds,
    origins: FloatArray,
    beams: FloatArray,
    out: FloatArray,
) -> None:
    """Fill `out` (N,) with the distances of the first hits of at most BLOCK rays."""
    feet, states = np.empty((BLOCK, 3)), np.empty((BLOCK, 9))
    scratch = np.empty((BLOCK, 3)), np.empty(BLOCK), np.empty((5, BLOCK))
    clear, under_way, count = np.empty(BLOCK), np.empty(BLOCK, np.int64), 0
    for i in range(len(out)):
        ray = (origins[i], beams[i], feet[i])
        first, end, start = _begin(surface, bounds, ray, bounds.ceiling)
        states[i] = 0.0
        states[i, _T] = first if first < end else np.nan
        states[i, _END], states[i, _START] = end, start
        if first < end:
            under_way[count] = i
            count += 1
    while count:
        _look(surface, (feet, beams, states), under_way[:count], scratch, clear)
        left = 0
        for j in range(count):
            i = under_way[j]
            if _advance(surface, bounds, (feet[i], beams[i]), states[i], clear[j]):
                under_way[left] = i
                left += 1
        count = left
    for i in range(len(out)):
        o, b = origins[i], beams[i]
        out[i] = states[i, _T] - (o[0] * b[0] + o[1] * b[1] + o[2] * b[2])


@kernel
def hits(
    surface: Surface, bounds: Bounds, origins: FloatArray, beams: FloatArray, out: FloatArray
) -> None:
    """Fill `out` (N,) with the distance of the first hit of each ray, NaN where it misses."""
    for start in range(0, len(out), BLOCK):
        end = min(start + BLOCK, len(out))
        _trace(surface, bounds, origins[start:end], beams[start:end], out[start:end])
