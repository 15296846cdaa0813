"""An instrument: its nominal camera, and the camera at an exposure."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from spcola.camera.camera import Camera
from spcola.camera.detector import SmearTimes
from spcola.camera.instrument.focal_length import FocusTable, ThermalFocus
from spcola.camera.instrument.pupil import Pupil
from spcola.errors import InvalidValueError


class Assumed(StrEnum):
    """What was assumed for want of knowledge."""

    NOMINAL_TEMPERATURE = "nominal-temperature"
    NOMINAL_FOCUS = "nominal-focus"
    END_OF_FOCUS_TABLE = "end-of-focus-table"

    @property
    def text(self) -> str:
        """The same in a sentence."""
        return {
            Assumed.NOMINAL_TEMPERATURE: "temperature unknown: the focal length is nominal",
            Assumed.NOMINAL_FOCUS: "focus and range unknown: the focal length is nominal",
            Assumed.END_OF_FOCUS_TABLE: "focus lies beyond the table: the nearest row is used",
        }[self]


@dataclass(frozen=True, eq=False)
class CameraAt:
    """A camera at one exposure.

    Parameters
    ----------
    camera : Camera
    assumed : tuple of Assumed
        What was not known; empty if nothing.
    """

    camera: Camera
    assumed: tuple[Assumed, ...]


@dataclass(frozen=True, eq=False)
class Instrument:
    """A camera by its name, with what its focal length depends on.

    Parameters
    ----------
    name : str
    camera : Camera
        Nominal.
    temperature : ThermalFocus, optional
    focus : FocusTable, optional
        Its focal lengths replace the nominal one; temperature multiplies them.
    pupil : Pupil, optional
        In the spacecraft; an instrument without one has it at the centre of mass.
    smear : SmearTimes, optional
        Of a detector without a shutter whose frame is moved into a memory.
    line_time_s : float, optional
        From one line's exposure to the next one's, seconds: of a line scanner, or of a rolling
        shutter; negative if the last line is exposed first.

    Raises
    ------
    InvalidValueError
        If the pupil is another camera's, or the time of a line is 0 or not finite.
    """

    name: str
    camera: Camera
    temperature: ThermalFocus | None = None
    focus: FocusTable | None = None
    pupil: Pupil | None = None
    smear: SmearTimes | None = None
    line_time_s: float | None = None

    def __post_init__(self) -> None:
        if self.pupil is not None and self.pupil.camera != self.name:
            raise InvalidValueError(f"has the pupil of {self.pupil.camera}", self.name)
        if self.line_time_s is not None and not 0.0 < abs(self.line_time_s) < np.inf:
            raise InvalidValueError(f"has lines of {self.line_time_s} s", self.name)

    def at(
        self,
        *,
        temperature_c: float | None = None,
        range_m: float | None = None,
        motor: float | None = None,
    ) -> CameraAt:
        """Return the camera at an exposure.

        Parameters
        ----------
        temperature_c : float, optional
            Of the camera's head, °C.
        range_m : float, optional
            To the surface in focus, metres; infinity is allowed. Not used where `motor` is known.
        motor : float, optional
            Position of the focus mechanism.

        Raises
        ------
        InvalidValueError
            If the range is not positive.
        """
        camera, assumed = self._focused(range_m, motor)
        if self.temperature is None:
            return CameraAt(camera, assumed)
        if temperature_c is None:
            return CameraAt(camera, (*assumed, Assumed.NOMINAL_TEMPERATURE))
        focal = camera.focal_length_mm * self.temperature.factor(temperature_c)
        return CameraAt(replace(camera, focal_length_mm=focal), assumed)

    def _focused(
        self, range_m: float | None, motor: float | None
    ) -> tuple[Camera, tuple[Assumed, ...]]:
        """Return the camera at its focus, and what was assumed."""
        if self.focus is None:
            return self.camera, ()
        if range_m is not None and not range_m > 0:
            raise InvalidValueError(f"must be positive, not {range_m} m", "range")
        if motor is None and range_m is None:
            return self.camera, (Assumed.NOMINAL_FOCUS,)
        beyond: tuple[Assumed, ...] = ()
        if motor is not None:
            inside = self.focus.covers(motor)
        else:
            assert range_m is not None
            inside = 1.0 / range_m <= self.focus.inverse_range[0]
            motor = self.focus.motor_at(range_m)
        if not inside:
            beyond = (Assumed.END_OF_FOCUS_TABLE,)
        focal, distortion = self.focus.at(motor)
        changed = distortion if len(distortion) else self.camera.distortion
        return replace(self.camera, focal_length_mm=focal, distortion=changed), beyond
