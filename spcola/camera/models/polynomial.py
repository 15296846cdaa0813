"""Models that are polynomials in two coordinates."""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera.models.model import Displacement, DistortionForm, partials


def _bicubic(a: FloatArray, x: FloatArray, y: FloatArray, focal_mm: float) -> Displacement:  # noqa: ARG001
    """Displacements dx and dy of third degree in x, y."""
    one, zero = np.ones_like(x + y), np.zeros_like(x + y)
    terms = np.stack(
        [one, x + zero, y + zero, x * x + zero, x * y, y * y + zero,
         x**3 + zero, x * x * y, x * y * y, y**3 + zero]
    )  # fmt: skip
    along_x = np.stack(
        [zero, one, zero, 2 * x + zero, y + zero, zero, 3 * x * x + zero, 2 * x * y, y * y + zero,
         zero]
    )  # fmt: skip
    along_y = np.stack(
        [zero, zero, one, zero, x + zero, 2 * y + zero, zero, x * x + zero, 2 * x * y,
         3 * y * y + zero]
    )  # fmt: skip
    both = a.reshape(2, 10)
    dx, dy = np.tensordot(both, terms, axes=1)
    (xx, yx), (xy, yy) = np.tensordot(both, along_x, axes=1), np.tensordot(both, along_y, axes=1)
    return dx, dy, partials(xx, xy, yx, yy)


# x and y themselves among the terms of the bi-cubic model
_IDENTITY = np.zeros(20)
_IDENTITY[[1, 12]] = 1.0


def _transverse(a: FloatArray, x: FloatArray, y: FloatArray, focal_mm: float) -> Displacement:
    """The true position itself, of third degree in the gnomonic x, y (USGS CSM, MESSENGER MDIS)."""
    return _bicubic(a - _IDENTITY, x, y, focal_mm)


def _rosetta(a: FloatArray, x: FloatArray, y: FloatArray, focal_mm: float) -> Displacement:  # noqa: ARG001
    """Polynomials of third degree in each of two pixel coordinates (ISIS, Rosetta OSIRIS).

    ``u = x/a0 + a1, v = y/a0 + a2``; the gnomonic position has
    ``u' = Σ A[j,i] uⁱ vʲ`` (a3 … a18, row by row) and ``v' = Σ B[j,i] uⁱ vʲ`` (a19 … a34).
    """
    pitch = a[0]
    u, v = x / pitch + a[1], y / pitch + a[2]
    to_u, to_v = a[3:19].reshape(4, 4), a[19:35].reshape(4, 4)
    # polyval2d takes c[i, j] of uⁱ vʲ
    value = np.polynomial.polynomial.polyval2d
    derive = np.polynomial.polynomial.polyder
    one = np.eye(2)
    by_u = [value(u, v, derive(c.T, axis=0)) for c in (to_u, to_v)]
    by_v = [value(u, v, derive(c.T, axis=1)) for c in (to_u, to_v)]
    return (
        pitch * (value(u, v, to_u.T) - u),
        pitch * (value(u, v, to_v.T) - v),
        partials(by_u[0], by_v[0], by_u[1], by_v[1]) - one,
    )


BICUBIC = DistortionForm((20,), _bicubic)
TRANSVERSE = DistortionForm((20,), _transverse)
ROSETTA = DistortionForm((35,), _rosetta, corrects=True)
