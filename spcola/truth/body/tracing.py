"""The first hits of rays on the synthetic body.

Rays are followed many at a time: all active rays are evaluated together, so that the roughness,
most of the work, is computed for several directions at once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spcola.arrays import FloatArray, IntArray
from spcola.compilation import compiled, compiled_inline
from spcola.truth.body.bounds import Bounds, fly
from spcola.truth.body.relief import BOULDER_SLOPE
from spcola.truth.body.surface import BLOCK, Surface, block_radii

_LEAST_STEP = 0.02
# Closer to the ground than this the bounds hardly ever help.
_WORTH_A_FLIGHT = 1.5
_ON_SURFACE = 1e-11
_MOST_LOOKS = 20_000

# State of an active ray: its present, final and first distances, the last place above the ground
# and the first below it with the clearances there, which of the two was kept last, and the number
# of evaluations. Distances are from the foot (the point of the ray nearest to O): of the size of
# the body, not of the range.
_T, _END, _START, _ABOVE, _F_ABOVE, _BELOW, _F_BELOW, _SIDE, _LOOKS = range(9)


class Rays(NamedTuple):
    """Active rays: each row is one, with unit `beams` (N, 3), `feet` (N, 3), `state` (N, 9).

    Kernels take all of them and a number: Numba would count references to a row cut out of an
    array, which takes longer than the work.
    """

    beams: FloatArray
    feet: FloatArray
    state: FloatArray


@compiled
def _begin(bounds: Bounds, rays: Rays, i: int, origins: FloatArray) -> bool:
    """Initialise a ray of the `origins` (N, 3); return whether it comes near the body at all."""
    beams, feet, state = rays
    state[i] = 0.0
    closest = 0.0
    for axis in range(3):
        closest -= origins[i, axis] * beams[i, axis]
    square = bounds.ceiling * bounds.ceiling
    for axis in range(3):
        feet[i, axis] = origins[i, axis] + closest * beams[i, axis]
        square -= feet[i, axis] * feet[i, axis]
    end = np.sqrt(max(square, 0.0))
    start = max(-end, -closest)
    state[i, _START], state[i, _END] = start, end
    state[i, _T] = fly(bounds, feet, beams, i, (start, end)) if start < end else end
    if state[i, _T] < end:
        return True
    state[i, _T] = np.nan
    return False


@compiled_inline
def _march(bounds: Bounds, rays: Rays, i: int) -> float:
    """Return the next place of a ray that is safely above the ground.

    The ground, no steeper for long than a boulder's side, cannot rise to it within the step; near
    the ground it jumps to the crossing extrapolated from the last two evaluations.
    """
    beams, feet, state = rays
    t, height = state[i, _T], state[i, _F_ABOVE]
    square, along = 0.0, 0.0
    for axis in range(3):
        place = feet[i, axis] + t * beams[i, axis]
        square += place * place
        along -= place * beams[i, axis]
    cosine = along / np.sqrt(square)
    rate = max(0.3, cosine + BOULDER_SLOPE * np.sqrt(max(0.0, 1.0 - cosine * cosine)))
    step = max(height / rate, _LEAST_STEP)
    fall = state[i, _F_BELOW]
    if fall > 0.0 and height < fall * bounds.leap:
        step = max(step, 1.02 * height / fall + 1e-4)
    t += step
    if height < _WORTH_A_FLIGHT:
        return t
    return fly(bounds, feet, beams, i, (t, state[i, _END]))


@compiled_inline
def _narrow(state: FloatArray, i: int) -> float:
    """Return the next place to evaluate between those above and below the ground.

    Regula falsi in the Illinois form; every eighth step bisects, so that a kink cannot stall it.
    """
    above, below = state[i, _ABOVE], state[i, _BELOW]
    if state[i, _LOOKS] % 8 == 7:
        return 0.5 * (above + below)
    share = state[i, _F_ABOVE] / (state[i, _F_ABOVE] - state[i, _F_BELOW])
    return above + (below - above) * share


@compiled_inline
def _bracket(state: FloatArray, i: int, value: float) -> bool:
    """Narrow the two places by the clearance between them; return whether to continue."""
    if value > 0.0:
        state[i, _ABOVE], state[i, _F_ABOVE] = state[i, _T], value
        state[i, _F_BELOW] *= 0.5 if state[i, _SIDE] == 1.0 else 1.0
        state[i, _SIDE] = 1.0
    else:
        state[i, _BELOW], state[i, _F_BELOW] = state[i, _T], value
        state[i, _F_ABOVE] *= 0.5 if state[i, _SIDE] == -1.0 else 1.0
        state[i, _SIDE] = -1.0
    width = state[i, _BELOW] - state[i, _ABOVE]
    if width < _ON_SURFACE or abs(value) < _ON_SURFACE:
        return False
    state[i, _T] = _narrow(state, i)
    return True


@compiled_inline
def _advance(bounds: Bounds, rays: Rays, i: int, value: float) -> bool:
    """Advance a ray by the clearance `value` at its place.

    Returns whether to continue; if not, it hit at ``state[_T]`` (NaN: it missed). Until the ground
    is crossed ``state[_F_BELOW]`` is the rate at which the clearance falls, ≥ 0.
    """
    state = rays.state
    state[i, _LOOKS] += 1.0
    if state[i, _F_BELOW] < 0.0:
        return _bracket(state, i, value)
    if value > 0.0:
        if state[i, _F_ABOVE] > 0.0:
            fall = (state[i, _F_ABOVE] - value) / (state[i, _T] - state[i, _ABOVE])
            state[i, _F_BELOW] = max(0.0, fall)
        state[i, _ABOVE], state[i, _F_ABOVE] = state[i, _T], value
        state[i, _T] = _march(bounds, rays, i)
    elif state[i, _F_ABOVE] > 0.0:
        state[i, _BELOW], state[i, _F_BELOW] = state[i, _T], min(value, -1e-300)
        state[i, _LOOKS] = 0.0
        state[i, _T] = _narrow(state, i)
    elif state[i, _T] > state[i, _START]:
        # It went too far, over ground steeper than the bounds allow for.
        state[i, _T] = max(state[i, _START], state[i, _T] + 3.0 * value - 0.1)
    else:
        # A ray that begins below the ground hits nothing.
        state[i, _T] = np.nan
    if not state[i, _T] < state[i, _END] or state[i, _LOOKS] > _MOST_LOOKS:
        state[i, _T] = np.nan
    return not np.isnan(state[i, _T])


@compiled
def _look(
    surface: Surface,
    rays: Rays,
    under_way: IntArray,
    scratch: tuple[FloatArray, FloatArray, FloatArray],
    clear: FloatArray,
) -> None:
    """Fill `clear` with the height over the ground of each ray in `under_way`."""
    beams, feet, state = rays
    directions, radius, block = scratch
    count = len(under_way)
    for j in range(count):
        i = under_way[j]
        t = state[i, _T]
        x = feet[i, 0] + t * beams[i, 0]
        y = feet[i, 1] + t * beams[i, 1]
        z = feet[i, 2] + t * beams[i, 2]
        length = np.sqrt(x * x + y * y + z * z)
        clear[j] = length
        directions[j, 0], directions[j, 1], directions[j, 2] = x / length, y / length, z / length
    block_radii(surface, directions[:count], radius[:count], block)
    for j in range(count):
        clear[j] -= radius[j]


@compiled
def _trace(
    surface: Surface, bounds: Bounds, origins: FloatArray, beams: FloatArray, out: FloatArray
) -> None:
    """Fill `out` (N,) with the distances of the first hits of at most BLOCK rays."""
    rays = Rays(beams, np.empty((BLOCK, 3)), np.empty((BLOCK, 9)))
    scratch = np.empty((BLOCK, 3)), np.empty(BLOCK), np.empty((6, BLOCK))
    clear, under_way, count = np.empty(BLOCK), np.empty(BLOCK, np.int64), 0
    for i in range(len(out)):
        if _begin(bounds, rays, i, origins):
            under_way[count] = i
            count += 1
    while count:
        _look(surface, rays, under_way[:count], scratch, clear)
        left = 0
        for j in range(count):
            i = under_way[j]
            if _advance(bounds, rays, i, clear[j]):
                under_way[left] = i
                left += 1
        count = left
    for i in range(len(out)):
        closest = 0.0
        for axis in range(3):
            closest -= origins[i, axis] * beams[i, axis]
        out[i] = closest + rays.state[i, _T]


@compiled
def hits(
    surface: Surface, bounds: Bounds, origins: FloatArray, beams: FloatArray, out: FloatArray
) -> None:
    """Fill `out` (N,) with the distance of the first hit of each ray, NaN where it misses."""
    for start in range(0, len(out), BLOCK):
        end = min(start + BLOCK, len(out))
        _trace(surface, bounds, origins[start:end], beams[start:end], out[start:end])
