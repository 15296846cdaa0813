"""Where a camera's pupil is in its spacecraft."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from spcola.arrays import FloatArray, check_finite, frozen
from spcola.errors import InvalidValueError


@dataclass(frozen=True, eq=False)
class Pupil:
    """Pupil of one camera of a spacecraft.

    Parameters
    ----------
    camera : str
        Name of the camera.
    offset : (3,) array_like
        From the spacecraft's centre of mass to the pupil, in the spacecraft's frame, metres.

    Raises
    ------
    InvalidValueError
        If the name is empty or the offset is not finite.
    """

    camera: str
    offset: FloatArray

    def __post_init__(self) -> None:
        if not self.camera.strip():
            raise InvalidValueError("has no name", "camera")
        object.__setattr__(self, "offset", frozen(self.offset, (3,), f"{self.camera}: pupil"))
        check_finite(self.offset, f"{self.camera}: pupil")

    def position(self, center_of_mass: ArrayLike, spacecraft_axes: ArrayLike) -> FloatArray:
        """Return positions of the pupil (…, 3), metres, in the frame of the centre of mass.

        Parameters
        ----------
        center_of_mass : (…, 3) array_like
            Metres.
        spacecraft_axes : (…, 3, 3) array_like
            Rows are the spacecraft's x, y, z in the frame of `center_of_mass`.
        """
        axes = np.asarray(spacecraft_axes, dtype=np.float64)
        moved = np.einsum("i,...ij->...j", self.offset, axes)
        place: FloatArray = np.asarray(center_of_mass, dtype=np.float64) + moved
        return place
