"""The camera projection, both ways, and its partials (Gaskell et al., eqs. 1–3, 8, 11, 12)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from spcola.arrays import FloatArray
from spcola.camera.camera import Camera
from spcola.camera.distortion import distort, distortion_jacobian, solve_2x2, undistort
from spcola.camera.image import SpcImage

MAX_ITERATIONS = 20
TOLERANCE_MM = 1e-12


def project_image(image: SpcImage, points: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return pixel and line (…) in an image of body-fixed points (…, 3), metres [1–3].

    The centre of the first pixel is (1, 1). NaN for a point at or behind the pupil plane; a
    point outside the detector gets the pixel and line at which it would lie.

    Parameters
    ----------
    image : SpcImage
        Camera and state; pixels are not needed.
    points : (…, 3) array_like
        Body-fixed, metres.
    """
    return project_vectors(image.camera, _in_camera(image, points))


def project_vectors(camera: Camera, vectors: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return pixel and line (…) of `vectors` (…, 3) in the axes of a `camera`, of any length [1–3].

    NaN for a vector at or behind the pupil plane, and where the distortion folds the plane over.
    """
    x, y = distort(camera, *_gnomonic(camera, np.asarray(vectors, dtype=np.float64)))
    (kxx, kxy, kxm), (kyx, kyy, kym) = camera.k_matrix
    pixel = camera.center[0] + kxx * x + kxy * y + kxm * x * y
    return pixel, camera.center[1] + kyx * x + kyy * y + kym * x * y


def ray(image: SpcImage, pixel: ArrayLike, line: ArrayLike) -> FloatArray:
    """Return the unit vectors (…, 3), body-fixed, of the rays through pixel and line (…).

    The inverse of `project_image`: the vector runs from ``image.position`` to the surface. NaN
    where the distortion cannot be inverted.

    Parameters
    ----------
    image : SpcImage
    pixel, line : (…) array_like
        From (1, 1) in the centre of the first pixel.
    """
    return view_vectors(image.camera, pixel, line) @ image.axes


def view_vectors(camera: Camera, pixel: ArrayLike, line: ArrayLike) -> FloatArray:
    """Return the unit vectors (…, 3), in the axes of a `camera`, through `pixel` and `line` (…).

    The inverse of `project_vectors`; NaN where the distortion cannot be inverted.
    """
    x, y = undistort(camera, *_focal_plane(camera, pixel, line))
    focal = np.full(np.shape(x), camera.focal_length_mm)
    seen = np.stack([x, y, focal], axis=-1)
    return seen / np.linalg.norm(seen, axis=-1, keepdims=True)


def partials_position(image: SpcImage, points: ArrayLike) -> FloatArray:
    """Return ∂(pixel, line)/∂W (…, 2, 3), per metre: also ∂/∂V and ∂/∂V0 [8].

    Includes the whole K-matrix and the distortion; without them this is [8] as printed, which
    the published estimation uses. `image` and `points` are as in :func:`project_image`.
    """
    turned = _in_camera(image, points)
    return _focal_partials(image.camera, turned) @ image.axes


def partials_rotation(image: SpcImage, points: ArrayLike) -> FloatArray:
    """Return ∂(pixel, line)/∂τ (…, 2, 3), per radian, for small turns about Cx, Cy, Cz [12].

    The turns move the axes by [11] (see `rotate_axes`). Includes the K-matrix and the distortion;
    `image` and `points` are as in :func:`project_image`.
    """
    return turn_partials(image.camera, _in_camera(image, points))


def turn_partials(camera: Camera, vectors: FloatArray) -> FloatArray:
    """Return ∂(pixel, line)/∂τ (…, 2, 3) of `vectors` (…, 3) in the axes of a `camera` [12]."""
    wx, wy, wz = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    zero = np.zeros_like(wx)
    # columns: change of (W·Cx, W·Cy, W·Cz) with τ1, τ2, τ3, from [11]
    moved = np.stack(
        [
            np.stack([zero, -wz, wy], axis=-1),
            np.stack([wz, zero, -wx], axis=-1),
            np.stack([-wy, wx, zero], axis=-1),
        ],
        axis=-2,
    )
    return _focal_partials(camera, vectors) @ moved


def rotate_axes(axes: ArrayLike, turns: ArrayLike) -> FloatArray:
    """Return camera `axes` (3, 3) after small `turns` τ (3,), radians, about Cx, Cy, Cz [11].

    Orthonormalised to the nearest set of axes afterwards, since [11] is linear.
    """
    rows = np.asarray(axes, dtype=np.float64)
    t1, t2, t3 = np.asarray(turns, dtype=np.float64)
    linear = np.array([[1.0, t3, -t2], [-t3, 1.0, t1], [t2, -t1, 1.0]]) @ rows
    u, _, vt = np.linalg.svd(linear)
    return u @ vt


def _in_camera(image: SpcImage, points: ArrayLike) -> FloatArray:
    """Return (W·Cx, W·Cy, W·Cz) (…, 3), metres, of W = V0 + V."""
    return (np.asarray(points, dtype=np.float64) + image.scobj) @ image.axes.T


def _gnomonic(camera: Camera, turned: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return focal-plane coordinates (mm), without distortion, of W [1]; NaN if behind."""
    depth = np.where(turned[..., 2] > 0, turned[..., 2], np.nan)
    scale = camera.focal_length_mm / depth
    return turned[..., 0] * scale, turned[..., 1] * scale


def _detector_jacobian(camera: Camera, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return ∂(pixel, line)/∂(x, y) (…, 2, 2), per mm: K with its mixed column."""
    mixed = camera.k_matrix[:, 2]
    other = np.stack([y, x], axis=-1)[..., None, :]
    return camera.k_matrix[:, :2] + mixed[:, None] * other


def _focal_partials(camera: Camera, turned: FloatArray) -> FloatArray:
    """Return ∂(pixel, line)/∂(W·Cx, W·Cy, W·Cz) (…, 2, 3), per metre; NaN if behind."""
    depth = np.where(turned[..., 2] > 0, turned[..., 2], np.nan)
    zero = np.zeros_like(depth)
    over = 1.0 / depth
    rows = [
        np.stack([over, zero, -turned[..., 0] * over**2], axis=-1),
        np.stack([zero, over, -turned[..., 1] * over**2], axis=-1),
    ]
    xp, yp = _gnomonic(camera, turned)
    bend = distortion_jacobian(camera, xp, yp)
    direct = _detector_jacobian(camera, *distort(camera, xp, yp)) @ bend
    return direct @ (camera.focal_length_mm * np.stack(rows, axis=-2))


def _focal_plane(
    camera: Camera, pixel: ArrayLike, line: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return the true focal-plane position (mm) of pixel and line (…): inverse of [3]."""
    shift = np.stack(np.broadcast_arrays(pixel, line), axis=-1) - camera.center
    linear, mixed = camera.k_matrix[:, :2], camera.k_matrix[:, 2]
    plane = shift @ np.linalg.inv(linear).T
    if not mixed.any():
        return plane[..., 0], plane[..., 1]
    for _ in range(MAX_ITERATIONS):
        x, y = plane[..., 0], plane[..., 1]
        residual = shift - plane @ linear.T - mixed * (x * y)[..., None]
        step = solve_2x2(_detector_jacobian(camera, x, y), residual)
        plane = plane + step
        if not np.any(np.abs(step) > TOLERANCE_MM):
            break
    plane[~np.all(np.abs(step) <= TOLERANCE_MM, axis=-1)] = np.nan
    return plane[..., 0], plane[..., 1]
