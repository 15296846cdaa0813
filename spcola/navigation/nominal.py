"""Nominal states: the spacecraft at an exposure according to the mission's navigation."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from spcola.arrays import FloatArray, check_axes, check_finite, frozen


@dataclass(frozen=True, eq=False)
class NominalState:
    """The a-priori state of an image.

    Parameters
    ----------
    name : str
        Name of the image.
    velocity : (3,) array_like
        Velocity of the spacecraft, body-fixed, m/s.
    scobj : (3,) array_like
        V0: from the spacecraft to the body's origin, body-fixed, metres.
    axes : (3, 3) array_like
        Rows Cx, Cy, Cz, body-fixed.
    scobj_sigma : (3,) array_like
        One standard deviation of V0, metres, along the axes of `sigma_frame`.
    pointing_sigma : (3,) array_like
        One standard deviation of the rotations about Cx, Cy, Cz, radians.
    sigma_frame : str
        The word after the velocity in the file: the frame of `scobj_sigma`.
    rest : tuple of str
        Further lines of the file, unchanged.

    Raises
    ------
    InvalidValueError
        If a vector has another shape or is not finite, or the axes are not orthonormal.
    """

    name: str
    velocity: FloatArray
    scobj: FloatArray
    axes: FloatArray
    scobj_sigma: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    pointing_sigma: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    sigma_frame: str = ""
    rest: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("velocity", "scobj", "scobj_sigma", "pointing_sigma"):
            object.__setattr__(self, name, frozen(getattr(self, name), (3,), f"{self.name}.{name}"))
        object.__setattr__(self, "axes", frozen(self.axes, (3, 3), f"{self.name}.axes"))
        check_finite(self.velocity, f"{self.name}.velocity")
        check_finite(self.scobj, f"{self.name}.scobj")
        check_axes(self.axes, f"{self.name}.axes")
