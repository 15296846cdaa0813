"""States of images from SPICE kernels, with light time and aberration as stated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
import spiceypy

from spcola.arrays import FloatArray, check_finite, frozen
from spcola.errors import KernelError
from spcola.navigation import SPICE_LOCK, utc_from_et
from spcola.navigation.states import ImageState, StateSource
from spcola.spice.kernels import (
    M_PER_KM,
    NOT_COVERED,
    POINTING_TOLERANCE_S,
    coverage,
    kernel_errors,
    rotation_near,
)

_SUN = "SUN"


class Correction(StrEnum):
    """How the direction and distance of the body differ from the geometric ones."""

    NONE = "none"
    LIGHT_TIME = "light-time"
    ABERRATION = "light-time+aberration"


_ABCORR = {
    Correction.NONE: "NONE",
    Correction.LIGHT_TIME: "LT",
    Correction.ABERRATION: "LT+S",
}


@dataclass(frozen=True, eq=False)
class SpiceCamera:
    """A camera by the names of SPICE.

    Parameters
    ----------
    spacecraft : str
        Name or NAIF number.
    body : int
        NAIF number of the body.
    frame : str
        The camera's frame: its axes are Cx, Cy, Cz.
    correction : Correction
        With light time, the body is where (and as far rotated as) it was when the light left it;
        with aberration, its direction is that seen from the moving spacecraft.
    pupil_m : (3,) array_like
        From the spacecraft's centre of mass to the camera's pupil, metres, along the axes of the
        camera's frame.
    tolerance_s : float
        Distance in time to a pointing of a CK at which it counts as known, s.
    """

    spacecraft: str
    body: int
    frame: str
    correction: Correction = Correction.ABERRATION
    pupil_m: FloatArray = field(default_factory=lambda: np.zeros(3))
    tolerance_s: float = POINTING_TOLERANCE_S

    def __post_init__(self) -> None:
        object.__setattr__(self, "pupil_m", frozen(self.pupil_m, (3,), "pupil"))
        check_finite(self.pupil_m, "pupil")


def spice_states(
    camera: SpiceCamera, names: Sequence[str], times: Sequence[float]
) -> list[ImageState]:
    """Return the states of images by the loaded kernels.

    To be called inside ``KernelSet.load()``. The rotation of the body is that of the loaded PCK
    (``tipbod``). The direction to the Sun is NaN where the kernels do not give its position.

    Parameters
    ----------
    camera : SpiceCamera
    names : sequence of str
        Of the images.
    times : sequence of float
        Middle of each exposure, ephemeris time, s.

    Raises
    ------
    KernelError
        If the kernels do not cover an exposure (with the gap), or a name is unknown.
    """
    with SPICE_LOCK:
        return [_state(camera, name, float(time)) for name, time in zip(names, times, strict=True)]


def clock_time(spacecraft: str, count: str) -> float:
    """Return the ephemeris time, s, of a count of a spacecraft's clock, ``3/0604882742.23115``.

    To be called inside ``KernelSet.load()``.

    Raises
    ------
    KernelError
        If the spacecraft is unknown, has no clock kernel, or the count is none.
    """
    with SPICE_LOCK, kernel_errors(f"clock of {spacecraft}, {count}"):
        return float(spiceypy.scs2e(spiceypy.bods2c(spacecraft), count))


def body_rate(body: int, time: float) -> FloatArray:
    """Return the angular velocity (3,), rad/s, body-fixed, of a body at an ephemeris time, s.

    To be called inside ``KernelSet.load()``.

    Raises
    ------
    KernelError
        If the kernels do not give the body's rotation.
    """
    with SPICE_LOCK, kernel_errors(f"rotation of {body}"):
        turn, rate = spiceypy.xf2rav(spiceypy.tisbod("J2000", body, time))
    turned: FloatArray = turn @ rate
    return turned


def _state(camera: SpiceCamera, name: str, time: float) -> ImageState:
    """Return the state of one image."""
    where = f"{name}, {utc_from_et(time)}"
    craft, body = camera.spacecraft, str(camera.body)
    with kernel_errors(where):
        try:
            toward, delay = spiceypy.spkpos(body, time, "J2000", _ABCORR[camera.correction], craft)
            velocity = spiceypy.spkezr(craft, time, "J2000", "NONE", body)[0][3:]
            axes = rotation_near(camera.frame, time, camera.tolerance_s).T
        except NOT_COVERED as error:
            raise KernelError(
                _gap(camera, time, error), where, "add kernels of that time"
            ) from error
        delay = 0.0 if camera.correction is Correction.NONE else delay
        turn = spiceypy.tipbod("J2000", camera.body, time - delay)
    axes = axes @ turn.T
    return ImageState(
        name,
        time,
        M_PER_KM * turn @ toward - camera.pupil_m @ axes,
        axes,
        StateSource.SPICE,
        sun=_sun(camera, time - delay, turn),
        velocity=M_PER_KM * turn @ velocity,
    )


def _sun(camera: SpiceCamera, time: float, turn: FloatArray) -> FloatArray:
    """Return the direction (3,) from the body to the Sun, body-fixed; NaN if unknown."""
    try:
        toward, _ = spiceypy.spkpos(
            _SUN, time, "J2000", _ABCORR[camera.correction], str(camera.body)
        )
    except NOT_COVERED:
        return np.full(3, np.nan)
    direction: FloatArray = turn @ toward / np.linalg.norm(toward)
    return direction


def _gap(camera: SpiceCamera, time: float, error: Exception) -> str:
    """Return what the kernels do not cover, and how far their coverage is."""
    parts = []
    for what, craft, frame in (("position", camera.spacecraft, ""), ("pointing", "", camera.frame)):
        known = coverage(craft, frame=frame, tolerance_s=camera.tolerance_s)
        if known.covers([time])[0]:
            continue
        ends = known.windows().ravel()
        before, after = ends[ends < time], ends[ends > time]
        text = [f"ends {time - before[-1]:.3f} s earlier"] if len(before) else []
        text += [f"begins {after[0] - time:.3f} s later"] if len(after) else []
        parts.append(f"{what} {' and '.join(text) or 'is in none of them'}")
    if parts:
        return f"the kernels do not cover the exposure: {'; '.join(parts)}"
    message = str(getattr(error, "long", "") or error).split(". ")[0]
    return f"SPICE reports: {message}"
