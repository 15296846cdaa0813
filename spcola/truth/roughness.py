"""Fractal roughness: gradient noise in space, from an integer hash.

Everything here is integer arithmetic and IEEE sums and products, so that a seed gives the same
surface on every machine. The noise is a function of the point in space, hence without seams or
poles on a body, and needs no storage at any resolution.
"""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray
from spcola.kernel import kernel

# Multipliers of SplitMix64 (Steele et al. 2014) and three odd constants that part the axes.
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_AXIS_X = np.uint64(0x9E3779B97F4A7C15)
_AXIS_Y = np.uint64(0xC2B2AE3D27D4EB4F)
_AXIS_Z = np.uint64(0x165667B19E3779F9)
_S27 = np.uint64(27)
_S30 = np.uint64(30)
_S31 = np.uint64(31)
_S60 = np.uint64(60)

# Perlin's sixteen gradients: the edges of a cube, four of them twice.
_GRADIENTS = np.array(
    [
        [1, 1, 0], [-1, 1, 0], [1, -1, 0], [-1, -1, 0],
        [1, 0, 1], [-1, 0, 1], [1, 0, -1], [-1, 0, -1],
        [0, 1, 1], [0, -1, 1], [0, 1, -1], [0, -1, -1],
        [1, 1, 0], [-1, 1, 0], [0, -1, 1], [0, -1, -1],
    ],
    dtype=np.float64,
)  # fmt: skip

NOISE_RMS = 0.2701
"""Root mean square of :func:`gradient_noise` over space (by sampling, ± 0.0002)."""


@kernel
def lattice_gradient(i: int, j: int, k: int, seed: int) -> int:
    """Return the gradient's number (0 … 15) at a lattice point."""
    word = np.uint64(seed)
    word += np.uint64(i) * _AXIS_X
    word += np.uint64(j) * _AXIS_Y
    word += np.uint64(k) * _AXIS_Z
    word = (word ^ (word >> _S30)) * _MIX_1
    word = (word ^ (word >> _S27)) * _MIX_2
    return int((word ^ (word >> _S31)) >> _S60)


@kernel
def _corner(i: int, j: int, k: int, offset: tuple[float, float, float], seed: int) -> float:
    """Return the gradient at (i, j, k) times the offset from there."""
    g = _GRADIENTS[lattice_gradient(i, j, k, seed)]
    return g[0] * offset[0] + g[1] * offset[1] + g[2] * offset[2]


@kernel
def _ease(t: float) -> float:
    """Perlin's quintic: first and second derivative vanish at 0 and 1."""
    return t * t * t * (t * (t * 6.0 - 15.0) + 10.0)


@kernel
def gradient_noise(x: float, y: float, z: float, seed: int) -> float:
    """Return gradient noise (Perlin 2002) at a point in units of the lattice; mean 0."""
    fx, fy, fz = np.floor(x), np.floor(y), np.floor(z)
    i, j, k = int(fx), int(fy), int(fz)
    x, y, z = x - fx, y - fy, z - fz
    u, v, w = _ease(x), _ease(y), _ease(z)
    value = 0.0
    for dk in range(2):
        wz = w if dk else 1.0 - w
        for dj in range(2):
            wy = v if dj else 1.0 - v
            near = _corner(i, j + dj, k + dk, (x, y - dj, z - dk), seed)
            far = _corner(i + 1, j + dj, k + dk, (x - 1.0, y - dj, z - dk), seed)
            value += wz * wy * (near + u * (far - near))
    return value


@kernel
def fractal_noise(x: float, y: float, z: float, octaves: FloatArray, seed: int) -> float:
    """Return the sum of octaves of noise at a point, in the unit of the amplitudes.

    `octaves` (K, 2) holds for each the lattice constants per metre and the amplitude (rms)
    divided by :data:`NOISE_RMS`; x, y, z are metres.
    """
    value = 0.0
    for octave in range(len(octaves)):
        f = octaves[octave, 0]
        value += octaves[octave, 1] * gradient_noise(x * f, y * f, z * f, seed + octave)
    return value


@kernel
def noise_field(octaves: FloatArray, seed: int, points: FloatArray, out: FloatArray) -> None:
    """Fill `out` (N,) with the fractal noise at `points` (N, 3), metres."""
    for i in range(len(points)):
        out[i] = fractal_noise(points[i, 0], points[i, 1], points[i, 2], octaves, seed)


def fractal_octaves(
    rms: float, reference: float, exponent: float, longest: float, shortest: float
) -> FloatArray:
    """Return octaves (K, 2) from wavelength `longest` down to `shortest`, metres, by halves.

    The rms of an octave of wavelength λ is ``rms · (λ / reference) ** exponent``, metres. The
    noise repeats its sign over about two lattice constants: that is taken as its wavelength.
    """
    if rms <= 0.0:
        return np.zeros((0, 2))
    count = int(np.floor(np.log2(longest / shortest) + 1e-9)) + 1
    wavelength = longest / 2.0 ** np.arange(count)
    amplitude = rms * (wavelength / reference) ** exponent / NOISE_RMS
    return np.stack([2.0 / wavelength, np.round(amplitude, 12)], axis=1)
