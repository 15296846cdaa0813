"""The radius of the synthetic body in any direction."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spcola.arrays import FloatArray
from spcola.compilation import compiled
from spcola.truth.body.cells import Indexed, cell_of
from spcola.truth.body.relief import boulder_height, crater_height
from spcola.truth.body.rocks import Rocks, raise_rocks
from spcola.truth.body.roughness import add_noise

BLOCK = 256
"""Directions evaluated together: their scratch memory fits the fastest cache."""


class Surface(NamedTuple):
    """Parameters of a surface for the kernels; lengths in metres.

    `shape` (11,) are the coefficients of :func:`low_degree`. `swells` and `octaves`
    are those of the roughness, longer and shorter than the smooth site, with an amplitude of
    ``1 + roughness_contrast · (y² − x²)``; the shorter ones are weaker on the `site` (6,): its
    direction, the chords of the unit sphere at which it ends and at which the ground is as rough
    as elsewhere, and the remaining share.
    """

    radius: float
    shape: FloatArray
    swells: FloatArray
    octaves: FloatArray
    roughness_contrast: float
    seed: int
    site: FloatArray
    craters: Indexed
    boulders: Indexed
    rocks: Rocks


@compiled
def low_degree(shape: FloatArray, x: float, y: float, z: float) -> float:
    """Return the smooth shape in the unit direction (x, y, z), as a factor of the mean radius.

    `shape` (11,) are the coefficients of P2, P3, P4 and those of the real and imaginary parts of
    ``z·(x+iy)``, ``(x+iy)²``, ``(x+iy)³``, ``(x+iy)⁴``. Only polynomials of the components: no
    sine or logarithm, which libraries round differently.
    """
    zz, c = z * z, shape
    value = 1.0 + c[0] * 0.5 * (3.0 * zz - 1.0) + c[1] * 0.5 * z * (5.0 * zz - 3.0)
    value += c[2] * 0.125 * (35.0 * zz * zz - 30.0 * zz + 3.0)
    value += z * (c[3] * x + c[4] * y)
    re, im = x * x - y * y, 2.0 * x * y
    value += c[5] * re + c[6] * im
    value += c[7] * (re * x - im * y) + c[8] * (re * y + im * x)
    return value + c[9] * (re * re - im * im) + c[10] * 2.0 * re * im


@compiled
def smoothed(surface: Surface, x: float, y: float, z: float) -> float:
    """Return the share of the short roughness that remains on the site in a unit direction."""
    s = surface.site
    dx, dy, dz = x - s[0], y - s[1], z - s[2]
    square = dx * dx + dy * dy + dz * dz
    if square >= s[4] * s[4]:
        return 1.0
    rise = max(0.0, (np.sqrt(square) - s[3]) / (s[4] - s[3]))
    return s[5] + (1.0 - s[5]) * rise * rise * (3.0 - 2.0 * rise)


@compiled
def crater_relief(surface: Surface, x: float, y: float, z: float) -> float:
    """Return the height of craters in a unit direction, metres (added to the radius)."""
    relief, craters = 0.0, surface.craters
    cell = cell_of(x, y, z, craters.cells)
    for place in range(craters.start[cell], craters.start[cell + 1]):
        crater = craters.numbers[craters.items[place]]
        relief += crater_height(x, y, z, surface.radius, crater)
    return relief


@compiled
def boulder_top(surface: Surface, x: float, y: float, z: float) -> float:
    """Return the height of a boulder in a unit direction, metres; 0 outside all."""
    top, boulders = 0.0, surface.boulders
    cell = cell_of(x, y, z, boulders.cells)
    for place in range(boulders.start[cell], boulders.start[cell + 1]):
        boulder = boulders.numbers[boulders.items[place]]
        top = max(top, boulder_height(x, y, z, surface.radius, boulder))
    return top


@compiled
def block_radii(surface: Surface, d: FloatArray, out: FloatArray, scratch: FloatArray) -> None:
    """Fill `out` (N,) with the radius in the unit directions `d` (N, 3).

    `scratch` is (6, M), M ≥ N.
    """
    count, size = len(out), surface.radius
    swell, rough, top = scratch[3], scratch[4], scratch[5]
    for i in range(count):
        for axis in range(3):
            scratch[axis, i] = size * d[i, axis]
        swell[i], rough[i] = 0.0, 0.0
    add_noise(scratch, surface.swells, surface.seed, swell, count)
    add_noise(scratch, surface.octaves, surface.seed, rough, count)
    for i in range(count):
        x, y, z = d[i, 0], d[i, 1], d[i, 2]
        strength = 1.0 + surface.roughness_contrast * (y * y - x * x)
        noise = strength * (swell[i] + smoothed(surface, x, y, z) * rough[i])
        ground = size * low_degree(surface.shape, x, y, z) + noise
        out[i] = ground + crater_relief(surface, x, y, z)
        top[i] = boulder_top(surface, x, y, z)
    if len(surface.rocks.cells):
        raise_rocks(surface.rocks, d, top, count)
    for i in range(count):
        out[i] += top[i]


@compiled
def radii(surface: Surface, directions: FloatArray, out: FloatArray) -> None:
    """Fill `out` (N,) with the radius in each of the unit `directions` (N, 3)."""
    scratch = np.empty((6, BLOCK))
    for start in range(0, len(out), BLOCK):
        end = min(start + BLOCK, len(out))
        block_radii(surface, directions[start:end], out[start:end], scratch)
