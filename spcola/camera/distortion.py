"""Lens distortion: from the gnomonic focal plane to the true one, and back [2].

Each model gives dx, dy in ``x = xp + dx(xp, yp)``, ``y = yp + dy(xp, yp)``, millimetres.

owen
    Owen (2011): ``(e2 r² + e4 r⁴ + e5 y + e6 x) (x, y) + (e1 r + e3 r³) (−y, x)``. Four
    coefficients are (e2, e4, e5, e6), without the pinwheel terms; six are e1 … e6.
brown
    Brown's model as OpenCV writes it: (k1, k2, p1, p2[, k3]) on coordinates divided by the
    focal length, and the result multiplied by it.
bicubic
    Two polynomials of third degree in x, y (mm): ten coefficients of dx, then ten of dy, in the
    order 1, x, y, x², xy, y², x³, x²y, xy², y³.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from spcola.arrays import FloatArray
from spcola.camera.camera import Camera
from spcola.errors import InvalidValueError

COEFFICIENTS = {"owen": (4, 6), "brown": (4, 5), "bicubic": (20,)}
"""Numbers of coefficients that each model may have; zeros of any length mean no distortion."""

MAX_ITERATIONS = 30
TOLERANCE_MM = 1e-12
"""Newton's step at which `undistort` stops: 1e-10 of a 10 µm pixel."""


def distort(camera: Camera, x: ArrayLike, y: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return the true focal-plane position (mm) of gnomonic positions x, y (…), mm [2].

    Raises
    ------
    InvalidValueError
        If the model does not allow the camera's number of coefficients.
    """
    xs, ys = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    dx, dy, _ = displacement(camera, xs, ys)
    return xs + dx, ys + dy


def distortion_jacobian(camera: Camera, x: ArrayLike, y: ArrayLike) -> FloatArray:
    """Return ∂(x, y)/∂(xp, yp) (…, 2, 2) of `distort`, dimensionless."""
    xs, ys = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    return np.eye(2) + displacement(camera, xs, ys)[2]


def undistort(camera: Camera, x: ArrayLike, y: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return the gnomonic position (mm) whose distorted position is x, y (…), mm.

    Newton's method; NaN where it does not converge (far outside the calibrated field).
    """
    target = np.stack(np.broadcast_arrays(x, y), axis=-1).astype(np.float64)
    if not camera.distortion.any():
        return target[..., 0], target[..., 1]
    guess = target.copy()
    step = np.full(target.shape, np.inf)
    for _ in range(MAX_ITERATIONS):
        dx, dy, slope = displacement(camera, guess[..., 0], guess[..., 1])
        residual = target - guess - np.stack([dx, dy], axis=-1)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            step = solve_2x2(np.eye(2) + slope, residual)
            guess = guess + step
        if not np.any(np.abs(step) > TOLERANCE_MM):
            break
    # a root where the image is folded over (x + k x³ beyond its turning point) is not this ray
    bend = np.eye(2) + displacement(camera, guess[..., 0], guess[..., 1])[2]
    upright = (np.trace(bend, axis1=-2, axis2=-1) > 0) & (np.linalg.det(bend) > 0)
    lost = ~(np.all(np.abs(step) <= TOLERANCE_MM, axis=-1) & upright)
    guess[lost] = np.nan
    return guess[..., 0], guess[..., 1]


def displacement(
    camera: Camera, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return dx, dy (mm) and their partials (…, 2, 2) at gnomonic x, y (…), mm.

    Raises
    ------
    InvalidValueError
        If the model does not allow the camera's number of coefficients.
    """
    coefficients = camera.distortion
    if not coefficients.any():
        zero = np.zeros(np.broadcast_shapes(x.shape, y.shape))
        return zero, zero, np.zeros((*zero.shape, 2, 2))
    model = camera.distortion_model
    if len(coefficients) not in COEFFICIENTS[model]:
        wanted = " or ".join(str(count) for count in COEFFICIENTS[model])
        raise InvalidValueError(
            f"the {model} model has {wanted} coefficients, not {len(coefficients)}", "distortion"
        )
    if model == "owen":
        return _owen(coefficients, x, y)
    if model == "brown":
        return _brown(coefficients, x, y, camera.focal_length_mm)
    return _bicubic(coefficients, x, y)


def solve_2x2(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solve matrices (…, 2, 2) for right-hand sides (…, 2) by Cramer's rule (no error if singular).

    A singular matrix gives infinity or NaN, which the caller must check.
    """
    a, b = matrix[..., 0, 0], matrix[..., 0, 1]
    c, d = matrix[..., 1, 0], matrix[..., 1, 1]
    u, v = right[..., 0], right[..., 1]
    return np.stack([d * u - b * v, a * v - c * u], axis=-1) / (a * d - b * c)[..., None]


def _matrix(xx: FloatArray, xy: FloatArray, yx: FloatArray, yy: FloatArray) -> FloatArray:
    """Stack four partials as (…, 2, 2)."""
    rows = [np.stack([xx, xy], axis=-1), np.stack([yx, yy], axis=-1)]
    return np.stack(rows, axis=-2)


def _owen(e: FloatArray, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Owen's model and its partials."""
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
    slopes = _matrix(
        radial + x * radial_x - y * wheel_x,
        x * radial_y - pinwheel - y * wheel_y,
        y * radial_x + pinwheel + x * wheel_x,
        radial + y * radial_y + x * wheel_y,
    )
    return radial * x - pinwheel * y, radial * y + pinwheel * x, slopes


def _brown(
    k: FloatArray, x_mm: FloatArray, y_mm: FloatArray, focal_mm: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Brown's model (OpenCV) and its partials."""
    k1, k2, p1, p2 = k[:4]
    k3 = k[4] if len(k) == 5 else 0.0
    x, y = x_mm / focal_mm, y_mm / focal_mm
    r2 = x * x + y * y
    radial = r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))  # d(radial)/dx = slope · x
    dx = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    dy = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    cross = slope * x * y + 2 * p1 * x + 2 * p2 * y
    slopes = _matrix(
        radial + slope * x * x + 2 * p1 * y + 6 * p2 * x,
        cross,
        cross,
        radial + slope * y * y + 6 * p1 * y + 2 * p2 * x,
    )
    return focal_mm * dx, focal_mm * dy, slopes


def _bicubic(
    a: FloatArray, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Third-degree polynomials and their partials."""
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
    return dx, dy, _matrix(xx, xy, yx, yy)
