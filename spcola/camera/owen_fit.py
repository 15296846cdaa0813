"""The camera with four coefficients of Owen's distortion that is nearest to a given one."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera.camera import Camera
from spcola.camera.models import MODELS
from spcola.camera.projection import project_vectors, view_vectors
from spcola.errors import InvalidValueError

__all__ = ["CameraDifference", "camera_difference", "fit_owen"]

# Points of the detector along each side at which two cameras are compared.
_POINTS = 33
_MOST_STEPS = 20
_STEP_PX = 1e-9
# A term that moves no point by so much is rounding error, and left out.
_NOISE_PX = 1e-6
# Fewer points than this share of the detector do not determine a distortion.
_LEAST_KNOWN = 0.5


@dataclass(frozen=True)
class CameraDifference:
    """How far two cameras are apart on the detector.

    Parameters
    ----------
    rms_px, largest_px : float
        Of the displacement of points, in pixels; infinite where only one of both sees a direction.
    """

    rms_px: float
    largest_px: float


def camera_difference(first: Camera, second: Camera) -> CameraDifference:
    """Return how far the second camera displaces what falls on points of the first one's detector.

    Points where the first camera sees nothing (beyond a fold of its distortion) are left out.
    """
    if _numbers(first) == _numbers(second):
        return CameraDifference(0.0, 0.0)
    pixel, line = _grid(first)
    seen = view_vectors(first, pixel, line)
    known = np.isfinite(seen).all(axis=-1)
    there = project_vectors(second, seen[known])
    away = np.hypot(there[0] - pixel[known], there[1] - line[known])
    away = np.where(np.isfinite(away), away, np.inf)
    if not away.size:
        return CameraDifference(np.inf, np.inf)
    return CameraDifference(float(np.sqrt(np.mean(away**2))), float(away.max()))


def fit_owen(camera: Camera, *, whole: bool) -> Camera:
    """Return the camera with Owen's distortion (e2, e4, e5, e6) that is nearest to `camera`.

    Least squares of the displacements, in pixels, of points all over the detector.

    Parameters
    ----------
    camera : Camera
        With any distortion.
    whole : bool
        Whether the centre and the linear part of K are fitted too (the focal length stays), as a
        distortion with terms of first degree needs; otherwise the distortion alone.

    Raises
    ------
    InvalidValueError
        If the camera's distortion folds over on most of its detector.
    """
    pixel, line = _grid(camera)
    target = np.stack([pixel, line], axis=-1)
    plane = np.stack(_ideal_plane(camera, pixel, line), axis=-1)
    known = np.isfinite(plane).all(axis=-1)
    if known.mean() < _LEAST_KNOWN:
        raise InvalidValueError(
            f"folds over on {1 - known.mean():.0%} of the detector",
            f"distortion ({camera.distortion_model})",
            "check its coefficients",
        )
    target, plane = target[known], plane[known]
    # Coefficients of coordinates in units of the detector's size: well-conditioned equations.
    size = float(np.max(np.abs(plane)))
    units = size ** -np.array([2.0, 4.0, 1.0, 1.0])
    basis = _basis(plane / size) * size
    values, k_matrix, center = np.zeros(4), np.array(camera.k_matrix), np.array(camera.center)
    for _ in range(_MOST_STEPS):
        moved = plane + basis @ values
        wanted = target - center - moved @ k_matrix[:, :2].T
        wanted -= k_matrix[:, 2] * np.prod(moved, axis=1, keepdims=True)
        design = _design(k_matrix[:, :2] @ basis, moved if whole else None)
        step = np.linalg.lstsq(design, wanted.ravel(), rcond=None)[0]
        values = values + step[:4]
        if whole:
            center, k_matrix[:, :2] = center + step[4:6], k_matrix[:, :2] + step[6:].reshape(2, 2)
        if np.max(np.abs(design @ step)) < _STEP_PX:
            break
    effect = np.max(np.abs(k_matrix[:, :2] @ basis), axis=(0, 1)) * np.abs(values)
    values = np.where(effect > _NOISE_PX, values * units, 0.0)
    return replace(
        camera, center=center, k_matrix=k_matrix, distortion_model="owen", distortion=values
    )


def _numbers(camera: Camera) -> tuple[object, ...]:
    """Return all that a camera is."""
    arrays = (camera.center, camera.k_matrix, camera.distortion)
    numbers = tuple(array.tobytes() for array in arrays)
    return (camera.focal_length_mm, camera.width, camera.height, camera.distortion_model, *numbers)


def _grid(camera: Camera) -> tuple[FloatArray, FloatArray]:
    """Return pixel and line (N,) of points all over the detector, edges included."""
    sides = [np.linspace(0.5, count + 0.5, _POINTS) for count in (camera.width, camera.height)]
    pixel, line = np.meshgrid(*sides)
    return pixel.ravel(), line.ravel()


def _ideal_plane(
    camera: Camera, pixel: FloatArray, line: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the gnomonic position (mm) of pixels and lines (N,)."""
    seen = view_vectors(camera, pixel, line)
    scale = camera.focal_length_mm / seen[:, 2]
    return seen[:, 0] * scale, seen[:, 1] * scale


def _basis(plane: FloatArray) -> FloatArray:
    """Return what each coefficient of Owen's model adds to positions (N, 2): (N, 2, 4)."""
    x, y = plane.T
    columns = []
    for unit in np.eye(4):
        dx, dy, _ = MODELS["owen"].shift(unit, x, y, 1.0)
        columns.append(np.stack([dx, dy], axis=-1))
    return np.stack(columns, axis=-1)


def _design(by_values: FloatArray, moved: FloatArray | None) -> FloatArray:
    """Return the partials (2 N, 4 or 10) of pixels and lines."""
    if moved is None:
        return by_values.reshape(-1, 4)
    count = len(by_values)
    by_center = np.broadcast_to(np.eye(2), (count, 2, 2))
    by_k = np.zeros((count, 2, 4))
    by_k[:, 0, :2] = by_k[:, 1, 2:] = moved
    return np.concatenate([by_values, by_center, by_k], axis=-1).reshape(2 * count, 10)
