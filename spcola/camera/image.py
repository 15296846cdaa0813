"""An SPC image: pixels, camera and spacecraft state."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from spcola.arrays import AnyArray, FloatArray, check_axes, check_finite, check_shape, frozen
from spcola.camera.camera import Camera
from spcola.errors import InvalidValueError


@dataclass(frozen=True)
class ImagePoint:
    """Place of a landmark (or a limb point) in an image.

    Parameters
    ----------
    name : str
        Of the landmark or image.
    pixel, line : float
        From (1, 1) in the centre of the first pixel.
    deweighted : bool
        The ``*`` that SPC puts after an observation that is kept but must have weight 0.
    extra : tuple of str
        The further numbers of a limb line, as in the file.
    """

    name: str
    pixel: float
    line: float
    deweighted: bool = False
    extra: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class SpcImage:
    """An image with the spacecraft state at which it was taken.

    Parameters
    ----------
    name : str
        At most 12 characters in SPC.
    utc : str
        Time of the exposure as in the file; :func:`spcola.navigation.et_from_utc` reads it.
    camera : Camera
        Interior orientation.
    scobj : (3,) array_like
        V0: from the spacecraft (camera pupil) to the body's origin, body-fixed, metres.
        The spacecraft is at −V0.
    axes : (3, 3) array_like
        Rows Cx, Cy, Cz in the body-fixed frame; Cz is the boresight.
    sun : (3,) array_like
        S: unit vector from the surface to the Sun, body-fixed.
    thresholds : (2,) of int
        Lowest and highest brightness that is used.
    scobj_sigma : (3,) array_like
        One standard deviation of V0, metres.
    pointing_sigma : (3,) array_like
        One standard deviation of the rotations about Cx, Cy, Cz, radians.
    landmarks, limbs : tuple of ImagePoint
        Landmarks and limb points seen in the image.
    pixels : (NLN, NPX) ndarray, optional
        Brightness; ``None`` where only the state is known.

    Raises
    ------
    InvalidValueError
        If a vector has another shape, is not finite, or the axes are not orthonormal.
    """

    name: str
    utc: str
    camera: Camera
    scobj: FloatArray
    axes: FloatArray
    sun: FloatArray
    thresholds: tuple[int, int] = (0, 65535)
    scobj_sigma: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    pointing_sigma: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    landmarks: tuple[ImagePoint, ...] = ()
    limbs: tuple[ImagePoint, ...] = ()
    pixels: AnyArray | None = None

    def __post_init__(self) -> None:
        for name in ("scobj", "sun", "scobj_sigma", "pointing_sigma"):
            object.__setattr__(self, name, frozen(getattr(self, name), (3,), f"{self.name}.{name}"))
        object.__setattr__(self, "axes", frozen(self.axes, (3, 3), f"{self.name}.axes"))
        check_finite(self.scobj, f"{self.name}.scobj")
        check_finite(self.sun, f"{self.name}.sun")
        check_axes(self.axes, f"{self.name}.axes")
        if abs(float(np.linalg.norm(self.sun)) - 1.0) > 1e-5:
            raise InvalidValueError("is not a unit vector", f"{self.name}.sun")
        if self.pixels is not None:
            shape = (self.camera.height, self.camera.width)
            check_shape(self.pixels, shape, f"{self.name}.pixels")

    @property
    def size(self) -> tuple[int, int]:
        """Samples and lines."""
        return self.camera.width, self.camera.height

    @property
    def pixel_angle(self) -> float:
        """Angle that one pixel subtends, radians."""
        return self.camera.pixel_angle

    @property
    def position(self) -> FloatArray:
        """Position of the spacecraft (camera pupil), body-fixed, metres: −V0."""
        return -self.scobj

    @property
    def boresight(self) -> FloatArray:
        """Cz (3,), unit, body-fixed."""
        return self.axes[2]
