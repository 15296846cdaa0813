"""The framing cameras of the synthetic mission, and their pointing to a target."""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera import Camera
from spcola.errors import SettingsError

__all__ = ["LEAST_DETECTOR", "framing_camera", "looking", "turned_to"]

# DellaGiustina et al., Table 1: both detectors, and the focal lengths (PolyCam's at infinity).
_PIXEL_MM, _DETECTOR = 0.0085, 1024
_FOCAL_LENGTHS_MM = {"MapCam": 125.0, "PolyCam": 628.9}
LEAST_DETECTOR = 16
"""Pixels across the smallest detector."""
# Decimals of the K-matrix in a .SUM file, so that it is exact there.
_K_DECIMALS = 4


def framing_camera(name: str, detector: int = _DETECTOR) -> Camera:
    """Return a camera like one of OSIRIS-REx.

    Parameters
    ----------
    name : {"MapCam", "PolyCam"}
        125 mm and 68 µrad a pixel, or 629 mm and 13.5 µrad.
    detector : int
        Pixels across. With fewer than the 1024 of the true ones pixels are larger, so that the
        field of view (70 and 14 mrad) is unchanged.

    Raises
    ------
    SettingsError
        If there is no such camera, or the detector has less than 16 pixels.
    """
    if name not in _FOCAL_LENGTHS_MM:
        raise SettingsError(f"{name!r} is none of {', '.join(_FOCAL_LENGTHS_MM)}", "camera")
    if detector < LEAST_DETECTOR:
        raise SettingsError(
            f"needs at least {LEAST_DETECTOR} pixels across, not {detector}", "detector"
        )
    per_mm = round(detector / _DETECTOR / _PIXEL_MM, _K_DECIMALS)
    k_matrix = np.array([[per_mm, 0.0, 0.0], [0.0, per_mm, 0.0]])
    center = np.full(2, (detector + 1) / 2.0)
    return Camera(_FOCAL_LENGTHS_MM[name], center, k_matrix, detector, detector)


def looking(position: FloatArray, target: FloatArray) -> FloatArray:
    """Return camera axes (3, 3), body-fixed, at `position` with the boresight to `target`.

    Cx lies in the body's equatorial plane, and Cy points to the south; straight above a pole, where
    that is undefined, Cx is the body's +X turned into the image.
    """
    cz = (target - position) / np.linalg.norm(target - position)
    cx = np.cross(cz, [0.0, 0.0, 1.0])
    if np.linalg.norm(cx) < 1e-9:
        cx = np.array([1.0, 0.0, 0.0]) - cz[0] * cz
    cx /= np.linalg.norm(cx)
    return np.stack([cx, np.cross(cz, cx), cz])


def turned_to(axes: FloatArray, boresight: FloatArray) -> FloatArray:
    """Return camera axes (3, 3) after the smallest rotation that brings Cz to unit `boresight`.

    There is no rotation about the boresight itself, also at a pole.
    """
    cz = axes[2]
    across = np.cross(cz, boresight)
    along = float(cz @ boresight)
    cross = np.array(
        [[0.0, -across[2], across[1]], [across[2], 0.0, -across[0]], [-across[1], across[0], 0.0]]
    )
    # Rodrigues' formula, with sine and cosine computed from the vectors.
    rotation = np.eye(3) + cross + cross @ cross / (1.0 + along)
    return axes @ rotation.T
