"""The state of an image at its exposure, and where it comes from."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from spcola.arrays import FloatArray, check_axes, check_finite, frozen
from spcola.camera import Camera, SpcImage
from spcola.errors import InvalidValueError
from spcola.navigation.nominal import NominalState
from spcola.navigation.time import et_from_utc, utc_from_et

_VECTORS = ("scobj", "sun", "velocity", "scobj_sigma", "pointing_sigma")
_UNIT = 1e-5


class StateSource(StrEnum):
    """Where the state of an image comes from."""

    SPICE = "spice"
    ISIS = "isis"
    ISD = "isd"
    PDS = "pds"
    POSES = "poses"
    COLMAP = "colmap"
    SUM = "sum"


def _unknown() -> FloatArray:
    return np.full(3, np.nan)


@dataclass(frozen=True, eq=False)
class ImageState:
    """Position and attitude of a camera at the middle of an exposure, and the direction to the Sun.

    Parameters
    ----------
    name : str
        Name of the image.
    time : float
        Middle of the exposure, ephemeris time (TDB seconds past J2000); NaN if unknown.
    scobj : (3,) array_like
        V0: from the camera's pupil to the body's origin, body-fixed, metres.
    axes : (3, 3) array_like
        Rows Cx, Cy, Cz, body-fixed; Cz is the boresight.
    source : StateSource
    sun : (3,) array_like
        Unit vector from the body to the Sun, body-fixed; NaN if unknown.
    velocity : (3,) array_like
        Velocity relative to the body's origin in an inertial frame, along the body-fixed axes, m/s;
        NaN if unknown.
    scobj_sigma : (3,) array_like
        One standard deviation of V0, metres; NaN if unknown.
    pointing_sigma : (3,) array_like
        One standard deviation of the rotations about Cx, Cy, Cz, radians; NaN if unknown.

    Raises
    ------
    InvalidValueError
        If a vector has another shape, the position is not finite, the axes are not orthonormal and
        right-handed, or the Sun's direction is no unit vector.
    """

    name: str
    time: float
    scobj: FloatArray
    axes: FloatArray
    source: StateSource
    sun: FloatArray = field(default_factory=_unknown)
    velocity: FloatArray = field(default_factory=_unknown)
    scobj_sigma: FloatArray = field(default_factory=_unknown)
    pointing_sigma: FloatArray = field(default_factory=_unknown)

    def __post_init__(self) -> None:
        for name in _VECTORS:
            object.__setattr__(self, name, frozen(getattr(self, name), (3,), f"{self.name}.{name}"))
        object.__setattr__(self, "axes", frozen(self.axes, (3, 3), f"{self.name}.axes"))
        check_finite(self.scobj, f"{self.name}.scobj")
        check_axes(self.axes, f"{self.name}.axes")
        if abs(float(np.linalg.norm(self.sun)) - 1.0) > _UNIT:
            raise InvalidValueError("is not a unit vector", f"{self.name}.sun")

    @property
    def position(self) -> FloatArray:
        """Position of the camera's pupil, body-fixed, metres: −V0."""
        return -self.scobj

    @classmethod
    def of_image(cls, image: SpcImage) -> ImageState:
        """Return the state of an SPC image (a .SUM file).

        Raises
        ------
        FormatError
            If its time cannot be read.
        """
        return cls(
            image.name,
            et_from_utc(image.utc),
            image.scobj,
            image.axes,
            StateSource.SUM,
            sun=image.sun,
            scobj_sigma=image.scobj_sigma,
            pointing_sigma=image.pointing_sigma,
        )

    def as_image(self, camera: Camera, *, thresholds: tuple[int, int] = (0, 65535)) -> SpcImage:
        """Return the image with this state and a camera, without pixels and landmarks.

        Parameters
        ----------
        camera : Camera
        thresholds : (int, int)
            Lowest and highest brightness that is used.

        Raises
        ------
        InvalidValueError
            If the time or the Sun's direction is unknown.
        """
        if not np.isfinite(self.time):
            raise InvalidValueError("has no time", self.name, "state when it was exposed")
        check_finite(self.sun, f"{self.name}.sun")
        return SpcImage(
            self.name,
            utc_from_et(self.time),
            camera,
            self.scobj,
            self.axes,
            self.sun,
            thresholds,
            self.scobj_sigma,
            self.pointing_sigma,
        )

    def as_nominal(self, body_rate: ArrayLike) -> NominalState:
        """Return the nominal state (a .NOM file).

        Its velocity is the rate of the body-fixed position: v − ω × r.

        Parameters
        ----------
        body_rate : (3,) array_like
            ω: angular velocity of the body, body-fixed, rad/s.

        Raises
        ------
        InvalidValueError
            If the velocity is unknown.
        """
        return NominalState(
            self.name,
            self.velocity - np.cross(np.asarray(body_rate, dtype=np.float64), self.position),
            self.scobj,
            self.axes,
            self.scobj_sigma,
            self.pointing_sigma,
        )
