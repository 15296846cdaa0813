"""Lens distortion: from the gnomonic focal plane to the true one, and back [2].

Most models give dx, dy in ``x = xp + dx(xp, yp)``, ``y = yp + dy(xp, yp)``, millimetres. Those
marked with * are defined the other way, ``xp = x + dx(x, y)``, and are inverted here.

owen
    Owen (2011): ``(e2 r² + e4 r⁴ + e5 y + e6 x) (x, y) + (e1 r + e3 r³) (−y, x)``. Four
    coefficients are (e2, e4, e5, e6), without the pinwheel terms; six are e1 … e6.
brown
    Brown's model as OpenCV writes it: (k1, k2, p1, p2[, k3[, k4, k5, k6]]) on coordinates divided
    by the focal length, and the result multiplied by it.
bicubic
    Two polynomials of third degree in x, y (mm): ten coefficients of dx, then ten of dy, in the
    order 1, x, y, x², xy, y², x³, x²y, xy², y³.
hasselblad *
    Apollo: (x0, y0, k1, k2, k3, j1, j2, t), principal point in mm, radial and decentring terms, t
    in radians. SPC's own form is not published; this is ISIS's for the Apollo metric camera
    (ApolloMetricDistortionMap; keywords PP, OD_K, DECENTER).
radial *
    The USGS's general form (CSM ``radial``, ISIS): ``xp = x (1 − k0 − k1 r² − k2 r⁴)``.
transverse
    CSM ``transverse``: as bicubic, but for x and y themselves, not for dx and dy.
rosetta *
    OSIRIS: polynomials of third degree in each pixel coordinate, (pixel in mm, line and sample of
    the axis from 0, 16 + 16 coefficients) as ISIS has it (keywords TO_UNDISTORTED_X and _Y; its x
    runs with lines). SPC's own form is not published.
hayabusa2 *
    ONC: ``R' = L0 R + L1 R³ + L2 R⁵`` in pixels (Suzuki et al., 2018; the archive's
    hyb2_onc_c_dist_20190131.db), coefficients (pixel in mm, L0, L1, L2). ISIS states the same
    formula, but its program squares r twice; the published formula is used here.
ocams
    OSIRIS-REx PolyCam, MapCam, SamCam as the ISIS addendum kernels have it (``OCAMS``):
    (x0, y0, k0 … k4), ``dx = (k0 + k1 r + … + k4 r⁴) (x − x0)``, r from (x0, y0).
lronac *
    LROC NAC (CSM ``lrolrocnac``): ``yp = y / (1 + k y²)``, x unchanged.

A lens that folds the plane over (x + k x³ beyond its turning point) has no image there: such
points are NaN in both directions.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from spcola.arrays import BoolArray, FloatArray
from spcola.camera.camera import Camera
from spcola.camera.models import MODELS, DistortionForm
from spcola.errors import InvalidValueError

COEFFICIENTS = {name: model.counts for name, model in MODELS.items()}
"""Numbers of coefficients that each model may have; zeros of any length mean no distortion."""

MAX_ITERATIONS = 30
TOLERANCE_MM = 1e-12
"""Newton's step at which the inverse stops, for a coordinate of up to 1 mm: 1e-10 of a pixel."""

# The plane is searched for folds up to this many radii of the detector.
_SEARCHED_RADII = 8.0
_RINGS = 256
_SECTORS = 32


def distort(camera: Camera, x: ArrayLike, y: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return the true focal-plane position (mm) of gnomonic positions x, y (…), mm [2].

    NaN where the plane is folded over.

    Raises
    ------
    InvalidValueError
        If the model does not allow the camera's number of coefficients.
    """
    xs, ys = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
    if not camera.distortion.any():
        return xs.copy(), ys.copy()
    return _inverse(camera, xs, ys) if _form(camera).corrects else _direct(camera, xs, ys)


def undistort(camera: Camera, x: ArrayLike, y: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return the gnomonic position (mm) whose distorted position is x, y (…), mm.

    NaN where there is none (far outside the calibrated field).

    Raises
    ------
    InvalidValueError
        If the model does not allow the camera's number of coefficients.
    """
    xs, ys = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
    if not camera.distortion.any():
        return xs.copy(), ys.copy()
    return _direct(camera, xs, ys) if _form(camera).corrects else _inverse(camera, xs, ys)


def distortion_jacobian(camera: Camera, x: ArrayLike, y: ArrayLike) -> FloatArray:
    """Return ∂(x, y)/∂(xp, yp) (…, 2, 2) of `distort`, dimensionless."""
    xs, ys = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
    if not camera.distortion.any():
        return np.broadcast_to(np.eye(2), (*xs.shape, 2, 2)).copy()
    if not _form(camera).corrects:
        return _bend(camera, xs, ys)
    back = _bend(camera, *_inverse(camera, xs, ys))
    # of matrices (…, 2, 2): a NaN gives NaN, not an error
    columns = [solve_2x2(back, np.broadcast_to(unit, back.shape[:-1])) for unit in np.eye(2)]
    return np.stack(columns, axis=-1)


def solve_2x2(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solve matrices (…, 2, 2) for right-hand sides (…, 2) by Cramer's rule (no error if singular).

    A singular matrix gives infinity or NaN, which the caller must check.
    """
    a, b = matrix[..., 0, 0], matrix[..., 0, 1]
    c, d = matrix[..., 1, 0], matrix[..., 1, 1]
    u, v = right[..., 0], right[..., 1]
    return np.stack([d * u - b * v, a * v - c * u], axis=-1) / (a * d - b * c)[..., None]


def unfolded_radius(camera: Camera) -> float:
    """Return the radius (mm) up to which the camera's model does not fold the plane over.

    About the optical axis, on the side on which the model is defined; searched in 32 directions.
    Infinity if nothing folds within eight radii of the detector.
    """
    values = (camera.center, camera.k_matrix, camera.distortion)
    numbers = b"".join(array.tobytes() for array in values)
    return _unfolded_radius(
        _Alike(
            camera,
            (camera.distortion_model, camera.focal_length_mm, camera.width, camera.height, numbers),
        )
    )


class _Alike(NamedTuple):
    """A camera that equals others with the same numbers: many images share one result."""

    camera: Camera
    key: tuple[object, ...]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Alike) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)


@lru_cache(maxsize=256)
def _unfolded_radius(alike: _Alike) -> float:
    """Search for the first ring about the axis on which the model is folded."""
    camera = alike.camera
    corners = np.linalg.solve(
        camera.k_matrix[:, :2],
        (np.array([[0.5, 0.5], [camera.width + 0.5, camera.height + 0.5]]) - camera.center).T,
    )
    largest = _SEARCHED_RADII * float(np.max(np.linalg.norm(corners, axis=0)))
    radius = np.linspace(0.0, largest, _RINGS + 1)[:, None]
    angle = np.linspace(0.0, 2 * np.pi, _SECTORS, endpoint=False)
    with np.errstate(all="ignore"):
        bend = _bend(camera, radius * np.cos(angle), radius * np.sin(angle))
    folded = np.flatnonzero(~np.all(_upright(bend), axis=1))
    return float(radius[folded[0], 0]) if len(folded) else np.inf


def _form(camera: Camera) -> DistortionForm:
    """Return the camera's model.

    Raises
    ------
    InvalidValueError
        If it does not allow the camera's number of coefficients.
    """
    form = MODELS[camera.distortion_model]
    count = len(camera.distortion)
    if count not in form.counts:
        wanted = " or ".join(str(number) for number in form.counts)
        raise InvalidValueError(
            f"the {camera.distortion_model} model has {wanted} coefficients, not {count}",
            "distortion",
        )
    return form


def _shift(camera: Camera, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return x, y moved by the model (…, 2), mm, and its Jacobian (…, 2, 2)."""
    dx, dy, slopes = _form(camera).shift(camera.distortion, x, y, camera.focal_length_mm)
    return np.stack([x + dx, y + dy], axis=-1), np.eye(2) + slopes


def _bend(camera: Camera, x: FloatArray, y: FloatArray) -> FloatArray:
    return _shift(camera, x, y)[1]


def _upright(bend: FloatArray) -> BoolArray:
    """Return whether matrices (…, 2, 2) keep the plane's orientation, without turning it over."""
    a, b = bend[..., 0, 0], bend[..., 0, 1]
    c, d = bend[..., 1, 0], bend[..., 1, 1]
    with np.errstate(invalid="ignore", over="ignore"):
        upright: BoolArray = (a + d > 0) & (a * d - b * c > 0)
    return upright


def _without_folds(camera: Camera, x: FloatArray, y: FloatArray, bend: FloatArray) -> BoolArray:
    """Return whether x, y (…), mm, lie where the model with Jacobian `bend` is one to one."""
    inside: BoolArray = _upright(bend) & (np.hypot(x, y) <= unfolded_radius(camera))
    return inside


def _direct(camera: Camera, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the model's position; NaN where it is folded."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        moved, bend = _shift(camera, x, y)
    moved[~_without_folds(camera, x, y, bend)] = np.nan
    return moved[..., 0], moved[..., 1]


def _inverse(camera: Camera, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return what the model moves to x, y, by Newton's method; NaN where it is folded."""
    target = np.stack([x, y], axis=-1)
    guess = target.copy()
    step = np.full(target.shape, np.inf)
    tolerance = TOLERANCE_MM * np.maximum(1.0, np.abs(target))
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for _ in range(MAX_ITERATIONS):
            moved, bend = _shift(camera, guess[..., 0], guess[..., 1])
            step = solve_2x2(bend, target - moved)
            guess = guess + step
            if not np.any(np.abs(step) > tolerance):
                break
        # Newton's method also finds roots behind a fold: they are not this ray.
        bend = _bend(camera, guess[..., 0], guess[..., 1])
    found = np.all(np.abs(step) <= tolerance, axis=-1)
    guess[~(found & _without_folds(camera, guess[..., 0], guess[..., 1], bend))] = np.nan
    return guess[..., 0], guess[..., 1]
