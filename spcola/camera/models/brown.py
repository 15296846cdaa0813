"""Brown's model as OpenCV writes it."""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera.models.model import Displacement, DistortionForm, partials


def _brown(k: FloatArray, x_mm: FloatArray, y_mm: FloatArray, focal_mm: float) -> Displacement:
    """``radial · (x, y)`` and tangential terms, on coordinates divided by the focal length.

    ``radial = (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶) − 1`` (OpenCV's
    documentation of camera calibration; ISIS uses it for OCAMS and TAGCAMS).
    """
    k1, k2, p1, p2, k3, k4, k5, k6 = np.concatenate([k, np.zeros(8 - len(k))])
    x, y = x_mm / focal_mm, y_mm / focal_mm
    r2 = x * x + y * y
    above, below = r2 * (k1 + r2 * (k2 + r2 * k3)), r2 * (k4 + r2 * (k5 + r2 * k6))
    above_r2, below_r2 = k1 + r2 * (2 * k2 + r2 * 3 * k3), k4 + r2 * (2 * k5 + r2 * 3 * k6)
    radial = (above - below) / (1.0 + below)
    slope = 2 * (above_r2 - (1.0 + radial) * below_r2) / (1.0 + below)  # d(radial)/dx = slope · x
    dx = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    dy = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    cross = slope * x * y + 2 * p1 * x + 2 * p2 * y
    slopes = partials(
        radial + slope * x * x + 2 * p1 * y + 6 * p2 * x,
        cross,
        cross,
        radial + slope * y * y + 6 * p1 * y + 2 * p2 * x,
    )
    return focal_mm * dx, focal_mm * dy, slopes


BROWN = DistortionForm((4, 5, 8), _brown)
