"""Models that move a point along its radius."""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera.models.model import Displacement, DistortionForm, along_radius, partials


def _radial(k: FloatArray, x: FloatArray, y: FloatArray, focal_mm: float) -> Displacement:  # noqa: ARG001
    """``−(k0 + k1 r² + k2 r⁴) (x, y)`` of the true x, y (USGS CSM and ISIS)."""
    r2 = x * x + y * y
    factor = -(k[0] + r2 * (k[1] + r2 * k[2]))
    return factor * x, factor * y, along_radius(factor, -(k[1] + 2 * k[2] * r2), x, y)


def _hayabusa2(k: FloatArray, x: FloatArray, y: FloatArray, focal_mm: float) -> Displacement:  # noqa: ARG001
    """``R' = L0 R + L1 R³ + L2 R⁵`` in pixels, with (pixel in mm, L0, L1, L2)."""
    pitch2 = k[0] * k[0]
    r2 = (x * x + y * y) / pitch2
    factor = (k[1] - 1.0) + r2 * (k[2] + r2 * k[3])
    return factor * x, factor * y, along_radius(factor, (k[2] + 2 * k[3] * r2) / pitch2, x, y)


def _ocams(k: FloatArray, x: FloatArray, y: FloatArray, focal_mm: float) -> Displacement:  # noqa: ARG001
    """``(k0 + k1 r + k2 r² + k3 r³ + k4 r⁴) (x − x0, y − y0)``, r from (x0, y0)."""
    away_x, away_y = x - k[0], y - k[1]
    r2 = away_x * away_x + away_y * away_y
    r = np.sqrt(r2)
    k0, k1, k2, k3, k4 = k[2:]
    factor = k0 + r * (k1 + r * (k2 + r * (k3 + r * k4)))
    # k1 r is not smooth at the centre, but times x − x0 it is: there its partials are zero
    half_k1 = np.divide(0.5 * k1, r, out=np.zeros_like(r), where=r > 0)
    per_r2 = half_k1 + k2 + r * (1.5 * k3 + r * 2 * k4)
    return factor * away_x, factor * away_y, along_radius(factor, per_r2, away_x, away_y)


def _lronac(k: FloatArray, x: FloatArray, y: FloatArray, focal_mm: float) -> Displacement:  # noqa: ARG001
    """``y' = y / (1 + k y²)`` along the detector; x is unchanged (ISIS and CSM, LROC NAC)."""
    under = 1.0 + k[0] * y * y
    zero = np.zeros_like(x + y)
    dy = y / under - y + zero
    return zero, dy, partials(zero, zero, zero, (1.0 - k[0] * y * y) / under**2 - 1.0 + zero)


RADIAL = DistortionForm((3,), _radial, corrects=True)
HAYABUSA2 = DistortionForm((4,), _hayabusa2, corrects=True)
OCAMS = DistortionForm((7,), _ocams)
LRONAC = DistortionForm((1,), _lronac, corrects=True)
