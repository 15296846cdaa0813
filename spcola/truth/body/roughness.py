"""Fractal roughness: gradient noise in space, from an integer hash.

Everything here is integer arithmetic and IEEE sums and products, so that a seed gives the same
surface on every machine. The noise is a function of the point in space, hence without seams or
poles on a body, and needs no storage at any resolution.

The hash has 32 bits and the gradients come from its bits without a table, so that loops over points
are vectorised: two to three times as fast.
"""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray
from spcola.compilation import compiled, compiled_inline

# Multipliers and shifts of Wellons' "lowbias32" hash (public domain), three odd constants (the
# primes of XXH32) that separate the axes, and one that separates the octaves.
_MIX_1 = np.uint32(0x7FEB352D)
_MIX_2 = np.uint32(0x846CA68B)
_AXIS_X = np.uint32(0x9E3779B1)
_AXIS_Y = np.uint32(0x85EBCA77)
_AXIS_Z = np.uint32(0xC2B2AE3D)
_OCTAVE = np.uint32(0x27D4EB2F)
_S15 = np.uint32(15)
_S16 = np.uint32(16)
_S10 = np.uint32(10)
_S20 = np.uint32(20)
_TEN_BITS = np.uint32(1023)
# A gradient's components are (n − 511.5) / 511.5 of ten bits n each: evenly from −1 to 1.
_HALF = 511.5

NOISE_RMS = 0.1911
"""Root mean square of :func:`gradient_noise` over space (by sampling, ± 0.0002)."""


@compiled
def mixed(word: np.uint32) -> np.uint32:
    """Return 32 bits that appear random for each value of `word`."""
    word = np.uint32(word ^ np.uint32(word >> _S16))
    word = np.uint32(word * _MIX_1)
    word = np.uint32(word ^ np.uint32(word >> _S15))
    word = np.uint32(word * _MIX_2)
    return np.uint32(word ^ np.uint32(word >> _S16))


@compiled
def _corner(word: np.uint32, x: float, y: float, z: float) -> float:
    """Return the gradient of a lattice point times the offset from there, times _HALF."""
    word = mixed(word)
    gx = np.int32(word & _TEN_BITS)
    gy = np.int32(np.uint32(word >> _S10) & _TEN_BITS)
    gz = np.int32(np.uint32(word >> _S20) & _TEN_BITS)
    return gx * x + gy * y + gz * z - _HALF * (x + y + z)


@compiled
def _ease(t: float) -> float:
    """Perlin's quintic: first and second derivative vanish at 0 and 1."""
    return t * t * t * (t * (t * 6.0 - 15.0) + 10.0)


@compiled_inline
def gradient_noise(x: float, y: float, z: float, seed: np.uint32) -> float:
    """Return gradient noise (Perlin 2002) at a point in units of the lattice; mean 0.

    Written out corner by corner: a loop over the corners would prevent the vectorisation of the
    loop over points.
    """
    fx, fy, fz = np.floor(x), np.floor(y), np.floor(z)
    x0 = np.uint32(np.uint32(np.int32(fx)) * _AXIS_X + seed)
    y0 = np.uint32(np.uint32(np.int32(fy)) * _AXIS_Y)
    z0 = np.uint32(np.uint32(np.int32(fz)) * _AXIS_Z)
    x1, y1, z1 = np.uint32(x0 + _AXIS_X), np.uint32(y0 + _AXIS_Y), np.uint32(z0 + _AXIS_Z)
    x, y, z = x - fx, y - fy, z - fz
    u, v, w = _ease(x), _ease(y), _ease(z)
    a = _corner(np.uint32(x0 + np.uint32(y0 + z0)), x, y, z)
    a += u * (_corner(np.uint32(x1 + np.uint32(y0 + z0)), x - 1.0, y, z) - a)
    b = _corner(np.uint32(x0 + np.uint32(y1 + z0)), x, y - 1.0, z)
    b += u * (_corner(np.uint32(x1 + np.uint32(y1 + z0)), x - 1.0, y - 1.0, z) - b)
    c = _corner(np.uint32(x0 + np.uint32(y0 + z1)), x, y, z - 1.0)
    c += u * (_corner(np.uint32(x1 + np.uint32(y0 + z1)), x - 1.0, y, z - 1.0) - c)
    d = _corner(np.uint32(x0 + np.uint32(y1 + z1)), x, y - 1.0, z - 1.0)
    d += u * (_corner(np.uint32(x1 + np.uint32(y1 + z1)), x - 1.0, y - 1.0, z - 1.0) - d)
    a += v * (b - a)
    c += v * (d - c)
    return (a + w * (c - a)) * (1.0 / _HALF)


@compiled
def add_noise(places: FloatArray, octaves: FloatArray, seed: int, out: FloatArray, n: int) -> None:
    """Add octaves of noise at the first `n` of the `places` (3, M), metres, to `out` (M,).

    `octaves` (K, 3) has for each the lattice constants per metre, the amplitude (rms) divided by
    :data:`NOISE_RMS`, and its number, which makes its lattice differ from the others'. Rows are
    contiguous and counted from 0, which vectorisation requires.
    """
    x, y, z = places[0], places[1], places[2]
    for octave in range(len(octaves)):
        f, amplitude = octaves[octave, 0], octaves[octave, 1]
        word = np.uint32(np.uint32(seed) + np.uint32(octaves[octave, 2]) * _OCTAVE)
        for i in range(n):
            out[i] += amplitude * gradient_noise(x[i] * f, y[i] * f, z[i] * f, word)


def fractal_octaves(
    rms: float, reference: float, exponent: float, longest: float, shortest: float
) -> FloatArray:
    """Return octaves (K, 3) from wavelength `longest` down to `shortest`, metres, by halves.

    The rms of an octave of wavelength λ is ``rms · (λ / reference) ** exponent``, metres. The
    noise repeats its sign over about two lattice constants, which define its wavelength.
    """
    if rms <= 0.0 or longest < shortest:
        return np.zeros((0, 3))
    count = int(np.floor(np.log2(longest / shortest) + 1e-9)) + 1
    wavelength = longest / 2.0 ** np.arange(count)
    amplitude = rms * (wavelength / reference) ** exponent / NOISE_RMS
    # Rounded: powers differ in the last bit between the libraries of machines.
    return np.stack([2.0 / wavelength, np.round(amplitude, 12), np.arange(count)], axis=1)
