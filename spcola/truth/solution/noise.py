"""Correlated errors of heights: on a maplet's cells, and on the body."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter

from spcola.arrays import FloatArray
from spcola.truth.body.roughness import add_noise, fractal_octaves

_OCTAVES = 3


def correlated_noise(
    shape: tuple[int, ...], correlation: float, generator: np.random.Generator
) -> FloatArray:
    """Return noise of rms 1 whose correlation is 1/e at a distance of `correlation` cells.

    White noise smoothed by a Gaussian of σ = correlation / 2, divided by the expected rms over all
    seeds: single samples are not scaled to their own.
    """
    width = correlation / 2.0
    margin = int(np.ceil(4.0 * width))
    white = generator.normal(size=(shape[0] + 2 * margin, shape[1] + 2 * margin))
    impulse = np.zeros(2 * margin + 1)
    impulse[margin] = 1.0
    gain = np.sum(gaussian_filter(impulse, width) ** 2)
    return gaussian_filter(white, width)[margin:-margin, margin:-margin] / gain


def drift_noise(points: FloatArray, wavelength: float, seed: int) -> FloatArray:
    """Return fractal noise (…) of rms 1 and a `seed` (32 bits) at body-fixed `points`, metres.

    It is a field in space, so that maplets with common ground share it. The longest `wavelength`,
    metres, has three quarters of its variance; two more follow by halves, each half as strong.
    """
    shortest = wavelength / 2.0 ** (_OCTAVES - 1)
    octaves = fractal_octaves(1.0, wavelength, 1.0, wavelength, shortest)
    places = np.ascontiguousarray(points.reshape(-1, 3).T)
    noise = np.zeros(places.shape[1])
    add_noise(places, octaves, seed, noise, len(noise))
    strength = np.sqrt(np.sum(0.25 ** np.arange(_OCTAVES)))
    return (noise / strength).reshape(points.shape[:-1])
