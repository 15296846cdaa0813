"""Directions spread evenly over the sphere."""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray


def lattice(count: int) -> FloatArray:
    """Return `count` unit vectors (N, 3) spread evenly over the sphere (Fibonacci's spiral)."""
    k = np.arange(count) + 0.5
    z = 1.0 - 2.0 * k / count
    longitude = np.pi * (1.0 + np.sqrt(5.0)) * k
    ring = np.sqrt(1.0 - z**2)
    return np.stack([ring * np.cos(longitude), ring * np.sin(longitude), z], axis=1)
