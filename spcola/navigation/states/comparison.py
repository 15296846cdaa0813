"""Difference of two states of one image: in metres, radians and pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from spcola.arrays import FloatArray
from spcola.camera import Camera
from spcola.errors import InvalidValueError
from spcola.navigation.states.image_state import ImageState, StateSource


@dataclass(frozen=True, eq=False)
class StateDifference:
    """State of an image from one source less that from another.

    Parameters
    ----------
    name : str
        Of the image.
    sources : (StateSource, StateSource)
        That of the first state and of the one subtracted.
    time_s : float
        Difference of the times, seconds.
    track_m : (3,) ndarray
        Difference of the positions, metres: along the track, across it, and radial (outward). The
        track is the velocity's part across the radius; NaN if no velocity is known.
    camera_m : (3,) ndarray
        The same along Cx, Cy, Cz of the second state.
    pointing : (3,) ndarray
        Rotation vector about Cx, Cy, Cz from the second attitude to the first, radians.
    pixels : (2,) ndarray
        Shift (pixel, line) at the boresight of a point at the distance of the body's origin that
        keeps its place on the body; NaN without a camera.
    sun : float
        Angle between the directions to the Sun, radians; NaN if unknown.
    """

    name: str
    sources: tuple[StateSource, StateSource]
    time_s: float
    track_m: FloatArray
    camera_m: FloatArray
    pointing: FloatArray
    pixels: FloatArray
    sun: float

    def as_json(self) -> dict[str, Any]:
        """Return the difference with angles in degrees."""
        return {
            "image": self.name,
            "sources": list(self.sources),
            "time_s": self.time_s,
            "track_m": self.track_m.tolist(),
            "camera_m": self.camera_m.tolist(),
            "pointing_deg": np.degrees(self.pointing).tolist(),
            "pixels": self.pixels.tolist(),
            "sun_deg": float(np.degrees(self.sun)),
        }


def compare_states(
    one: ImageState, two: ImageState, camera: Camera | None = None
) -> StateDifference:
    """Return the state `one` less the state `two` of the same image.

    Parameters
    ----------
    one, two : ImageState
    camera : Camera, optional
        Gives the difference in pixels.

    Raises
    ------
    InvalidValueError
        If they are states of two images.
    """
    if one.name != two.name:
        raise InvalidValueError(f"is compared with {two.name}", one.name, "compare one image")
    moved = one.position - two.position
    turn: FloatArray = Rotation.from_matrix(two.axes @ one.axes.T).as_rotvec()
    cosine = np.clip(one.sun @ two.sun, -1.0, 1.0)
    return StateDifference(
        one.name,
        (one.source, two.source),
        one.time - two.time,
        _track(one, two) @ moved,
        two.axes @ moved,
        turn,
        _pixels(one, two, camera),
        float(np.arccos(cosine)),
    )


def _track(one: ImageState, two: ImageState) -> FloatArray:
    """Return the directions (3, 3) along, across and radial; NaN where no velocity is known."""
    radial = two.position / np.linalg.norm(two.position)
    velocity = two.velocity if np.isfinite(two.velocity).all() else one.velocity
    along = velocity - (velocity @ radial) * radial
    speed = np.linalg.norm(along)
    along = along / speed if speed > 0.0 else np.full(3, np.nan)
    return np.array([along, np.cross(radial, along), radial])


def _pixels(one: ImageState, two: ImageState, camera: Camera | None) -> FloatArray:
    """Return the shift (2,), pixel and line, of a point on the second boresight."""
    if camera is None:
        return np.full(2, np.nan)
    point = two.position + abs(float(two.scobj @ two.axes[2])) * two.axes[2]
    places = []
    for state in (one, two):
        x, y, z = state.axes @ (state.scobj + point)
        if z <= 0.0:
            return np.full(2, np.nan)
        plane = camera.focal_length_mm / z * np.array([x, y])
        places.append(camera.k_matrix @ np.array([*plane, plane[0] * plane[1]]))
    shift: FloatArray = places[0] - places[1]
    return shift
