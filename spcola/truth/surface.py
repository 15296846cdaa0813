"""The radius of the synthetic body in any direction, and the first hit of a ray on it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spcola.arrays import FloatArray, IntArray
from spcola.kernel import kernel
from spcola.truth.relief import boulder_height, cell_of, crater_height
from spcola.truth.roughness import fractal_noise

# A ray goes on by this share of its height above the ground: the ground, with slopes up to 63°,
# cannot come to meet it within the step.
_STEP_SHARE = 0.45
_LEAST_STEP = 0.02
# Above all relief only the smooth shape counts, of which the slopes stay under 40°.
_SMOOTH_SHARE = 0.7
_NEAR_COVER = 0.3
_ON_SURFACE = 1e-11
_MOST_STEPS = 20_000
_MOST_REFINEMENTS = 80


class Surface(NamedTuple):
    """All numbers of a surface, as the kernels take them; lengths in metres.

    `zonal` (3,) are the coefficients of P2, P3, P4; `tesseral` (4, 2) those of the real and
    imaginary part of ``z·(x+iy)``, ``(x+iy)²``, ``(x+iy)³``, ``(x+iy)⁴``. `octaves` are those of
    the roughness, of which the amplitude goes as ``1 + roughness_contrast · (y² − x²)``; features
    are listed by cells of a cube (see :func:`spcola.truth.relief.index_features`). No point of the
    surface is further from O than `ceiling`, or more than `cover` above the smooth shape.
    """

    radius: float
    zonal: FloatArray
    tesseral: FloatArray
    octaves: FloatArray
    roughness_contrast: float
    seed: int
    cells: int
    craters: FloatArray
    crater_start: IntArray
    crater_items: IntArray
    boulders: FloatArray
    boulder_start: IntArray
    boulder_items: IntArray
    ceiling: float
    cover: float


@kernel
def low_degree(surface: Surface, x: float, y: float, z: float) -> float:
    """Return the smooth shape in the unit direction (x, y, z), as a factor of the mean radius.

    Polynomials of the components alone: no sine or logarithm that libraries round differently.
    """
    zz = z * z
    c, t = surface.zonal, surface.tesseral
    value = 1.0 + c[0] * 0.5 * (3.0 * zz - 1.0) + c[1] * 0.5 * z * (5.0 * zz - 3.0)
    value += c[2] * 0.125 * (35.0 * zz * zz - 30.0 * zz + 3.0)
    value += z * (t[0, 0] * x + t[0, 1] * y)
    re, im = x * x - y * y, 2.0 * x * y
    value += t[1, 0] * re + t[1, 1] * im
    value += t[2, 0] * (re * x - im * y) + t[2, 1] * (re * y + im * x)
    return value + t[3, 0] * (re * re - im * im) + t[3, 1] * 2.0 * re * im


@kernel
def radius_at(surface: Surface, x: float, y: float, z: float) -> float:
    """Return the radius, metres, in the unit direction (x, y, z)."""
    size = surface.radius
    ground = size * low_degree(surface, x, y, z)
    rough = 1.0 + surface.roughness_contrast * (y * y - x * x)
    ground += rough * fractal_noise(x * size, y * size, z * size, surface.octaves, surface.seed)
    cell = cell_of(x, y, z, surface.cells)
    for item in range(surface.crater_start[cell], surface.crater_start[cell + 1]):
        ground += crater_height(x, y, z, size, surface.craters[surface.crater_items[item]])
    boulder = 0.0
    for item in range(surface.boulder_start[cell], surface.boulder_start[cell + 1]):
        height = boulder_height(x, y, z, size, surface.boulders[surface.boulder_items[item]])
        boulder = max(boulder, height)
    return ground + boulder


@kernel
def radii(surface: Surface, directions: FloatArray, out: FloatArray) -> None:
    """Fill `out` (N,) with the radius in each of the unit `directions` (N, 3)."""
    for i in range(len(directions)):
        out[i] = radius_at(surface, directions[i, 0], directions[i, 1], directions[i, 2])


@kernel
def clearance(surface: Surface, px: float, py: float, pz: float) -> float:
    """Return how far a point lies above the surface along its own radius, metres."""
    length = np.sqrt(px * px + py * py + pz * pz)
    return length - radius_at(surface, px / length, py / length, pz / length)


@kernel
def _along(surface: Surface, origin: FloatArray, beam: FloatArray, t: float) -> float:
    """Clearance at `origin` + t·`beam`."""
    return clearance(
        surface,
        origin[0] + t * beam[0],
        origin[1] + t * beam[1],
        origin[2] + t * beam[2],
    )


@kernel
def _crossing(
    surface: Surface,
    origin: FloatArray,
    beam: FloatArray,
    above: tuple[float, float],
    below: tuple[float, float],
) -> float:
    """Return where the clearance crosses zero between `above` and `below`: (t, clearance) each.

    Regula falsi in the Illinois form, which halves the value of an end that stays twice; every
    eighth step bisects, so that a kink cannot stall it.
    """
    side = 0
    (t_above, f_above), (t_below, f_below) = above, below
    for step in range(_MOST_REFINEMENTS):
        middle = 0.5 * (t_above + t_below)
        if step % 8 != 7:
            middle = t_above + (t_below - t_above) * f_above / (f_above - f_below)
        value = _along(surface, origin, beam, middle)
        if abs(value) < _ON_SURFACE or t_below - t_above < _ON_SURFACE:
            return middle
        if value > 0.0:
            t_above, f_above = middle, value
            f_below *= 0.5 if side == 1 else 1.0
            side = 1
        else:
            t_below, f_below = middle, value
            f_above *= 0.5 if side == -1 else 1.0
            side = -1
    return 0.5 * (t_above + t_below)


@kernel
def _above_relief(
    surface: Surface, origin: FloatArray, beam: FloatArray, t: float, end: float
) -> float:
    """Return how far a ray may go from t (to `end` at most) without meeting any relief."""
    while t < end:
        x = origin[0] + t * beam[0]
        y = origin[1] + t * beam[1]
        z = origin[2] + t * beam[2]
        length = np.sqrt(x * x + y * y + z * z)
        smooth = surface.radius * low_degree(surface, x / length, y / length, z / length)
        gap = length - smooth - surface.cover
        if gap < _NEAR_COVER:
            break
        t += _SMOOTH_SHARE * gap
    return t


@kernel
def first_hit(surface: Surface, origin: FloatArray, beam: FloatArray) -> float:
    """Return the distance along the unit vector `beam` to the surface, NaN for a miss, metres.

    The ray is followed from where it enters the sphere around the body, in steps that shrink with
    the height above the ground, until it is below; what is grazed by less than 2 cm may be missed.
    """
    closest = -(origin[0] * beam[0] + origin[1] * beam[1] + origin[2] * beam[2])
    foot = origin + closest * beam
    square = surface.ceiling**2 - (foot[0] ** 2 + foot[1] ** 2 + foot[2] ** 2)
    if square <= 0.0 or closest + np.sqrt(square) < 0.0:
        return np.nan
    # Distances from the foot (the point next to O): of the body's size, not of the range's.
    end = np.sqrt(square)
    t = max(-end, -closest)
    last = (t, 0.0)
    for _ in range(_MOST_STEPS):
        t = _above_relief(surface, foot, beam, t, end)
        if t >= end:
            break
        height = _along(surface, foot, beam, t)
        if height < 0.0:
            # A ray that begins below the ground has nothing to hit.
            return (
                closest + _crossing(surface, foot, beam, last, (t, height)) if last[1] else np.nan
            )
        last = (t, height)
        t += max(_STEP_SHARE * height, _LEAST_STEP)
    return np.nan


@kernel
def hits(surface: Surface, origins: FloatArray, beams: FloatArray, out: FloatArray) -> None:
    """Fill `out` (N,) with the distance of the first hit of each ray, NaN where it misses."""
    for i in range(len(origins)):
        out[i] = first_hit(surface, origins[i], beams[i])
