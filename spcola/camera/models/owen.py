"""Owen's model, the usual one of SPC."""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera.models.model import Displacement, DistortionForm, partials


def _owen(e: FloatArray, x: FloatArray, y: FloatArray, focal_mm: float) -> Displacement:  # noqa: ARG001
    """``(e2 r² + e4 r⁴ + e5 y + e6 x) (x, y) + (e1 r + e3 r³) (−y, x)`` (Owen, 2011)."""
    e1, e2, e3, e4, e5, e6 = e if len(e) == 6 else (0.0, e[0], 0.0, e[1], e[2], e[3])
    r2 = x * x + y * y
    r = np.sqrt(r2)
    radial = e2 * r2 + e4 * r2 * r2 + e5 * y + e6 * x
    pinwheel = e1 * r + e3 * r * r2
    radial_x = 2 * x * (e2 + 2 * e4 * r2) + e6
    radial_y = 2 * y * (e2 + 2 * e4 * r2) + e5
    # d(e1 r)/dx = e1 x/r: times y or x it vanishes on the axis, where x/r itself is undefined
    per_r = np.divide(e1, r, out=np.zeros_like(r), where=r > 0) + 3 * e3 * r
    wheel_x, wheel_y = per_r * x, per_r * y
    slopes = partials(
        radial + x * radial_x - y * wheel_x,
        x * radial_y - pinwheel - y * wheel_y,
        y * radial_x + pinwheel + x * wheel_x,
        radial + y * radial_y + x * wheel_y,
    )
    return radial * x - pinwheel * y, radial * y + pinwheel * x, slopes


OWEN = DistortionForm((4, 6), _owen)
