"""Apollo's frame cameras: radial and decentring distortion about the principal point."""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera.models.model import Displacement, DistortionForm, along_radius, partials


def _hasselblad(a: FloatArray, x: FloatArray, y: FloatArray, focal_mm: float) -> Displacement:  # noqa: ARG001
    """Brown's classical form on the true x, y, as ISIS has it for Apollo's metric camera.

    With (x0, y0, k1, k2, k3, j1, j2, t), u = x − x0, v = y − y0, r² = u² + v² the gnomonic
    position is ``u (1 + k1 r² + k2 r⁴ + k3 r⁶) − (j1 r² + j2 r⁴) sin t`` and
    ``v (1 + k1 r² + k2 r⁴ + k3 r⁶) + (j1 r² + j2 r⁴) cos t``.
    """
    x0, y0, k1, k2, k3, j1, j2, angle = a
    u, v = x - x0, y - y0
    r2 = u * u + v * v
    factor = r2 * (k1 + r2 * (k2 + r2 * k3))
    across = r2 * (j1 + r2 * j2)
    slope = 2 * (j1 + 2 * r2 * j2)
    sine, cosine = np.sin(angle), np.cos(angle)
    slopes = along_radius(factor, k1 + r2 * (2 * k2 + r2 * 3 * k3), u, v)
    slopes = slopes + partials(
        -sine * slope * u, -sine * slope * v, cosine * slope * u, cosine * slope * v
    )
    return u * factor - across * sine - x0, v * factor + across * cosine - y0, slopes


def turned_metric_camera(
    principal: FloatArray, radial: FloatArray, decentring: FloatArray
) -> FloatArray:
    """Return the coefficients (8,) of Apollo's metric camera with its axes turned about x.

    Its focal plane lies behind the pupil in ISIS. With y and z turned, y0 changes its sign, and t
    becomes π − t.

    Parameters
    ----------
    principal : (2,) ndarray
        PP of its kernel.
    radial : (3,) ndarray
        OD_K.
    decentring : (3,) ndarray
        DECENTER.
    """
    x0, y0 = principal
    j1, j2, angle = decentring
    return np.array([x0, -y0, *radial, j1, j2, np.pi - angle])


HASSELBLAD = DistortionForm((8,), _hasselblad, corrects=True)
