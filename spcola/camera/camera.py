"""Framing cameras: focal length, pixel matrix and distortion."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from spcola.arrays import FloatArray, check_finite, frozen
from spcola.errors import InvalidValueError

DistortionModel = Literal[
    "owen", "brown", "bicubic", "hasselblad", "radial", "transverse", "rosetta", "hayabusa2",
    "ocams", "lronac",
]  # fmt: skip


@dataclass(frozen=True, eq=False)
class Camera:
    """Interior orientation of a framing camera (Gaskell et al., eqs. 1–3).

    Parameters
    ----------
    focal_length_mm : float
        Millimetres, the unit of the focal plane in SPC.
    center : (2,) array_like
        Pixel and line of the optical axis; the centre of the first pixel is (1, 1).
    k_matrix : (2, 3) array_like
        Pixel/line per millimetre, applied to (x, y, x·y).
    width, height : int
        NPX and NLN.
    distortion_model : str
        How `distortion` is to be read; the names are those of :mod:`spcola.camera.distortion`.
    distortion : array_like
        Coefficients; empty or all zero for none.

    Raises
    ------
    InvalidValueError
        If a value is not finite, the focal length not positive, K singular, or the model unknown.
    """

    focal_length_mm: float
    center: FloatArray
    k_matrix: FloatArray
    width: int
    height: int
    distortion_model: DistortionModel = "owen"
    distortion: FloatArray = field(default_factory=lambda: np.zeros(4))

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", frozen(self.center, (2,), "center"))
        object.__setattr__(self, "k_matrix", frozen(self.k_matrix, (2, 3), "k_matrix"))
        object.__setattr__(self, "distortion", frozen(self.distortion, (None,), "distortion"))
        for name in ("center", "k_matrix", "distortion"):
            check_finite(getattr(self, name), name)
        if not (np.isfinite(self.focal_length_mm) and self.focal_length_mm > 0):
            raise InvalidValueError(f"must be positive, not {self.focal_length_mm}", "focal length")
        with np.errstate(over="ignore", invalid="ignore"):
            determinant = float(np.linalg.det(self.k_matrix[:, :2]))
        if not 1e-12 <= abs(determinant) < np.inf:
            raise InvalidValueError("is singular: no pixel can be traced back", "K-matrix")
        if self.distortion_model not in get_args(DistortionModel):
            known = ", ".join(get_args(DistortionModel))
            raise InvalidValueError(
                f"{self.distortion_model!r} is no distortion; known are {known}", "camera"
            )
        if self.width < 1 or self.height < 1:
            raise InvalidValueError(f"has no pixels ({self.width} × {self.height})", "camera")

    @property
    def pixel_angle(self) -> float:
        """Angle that one pixel subtends at the boresight, radians (geometric mean of both)."""
        per_mm = np.sqrt(abs(np.linalg.det(self.k_matrix[:, :2])))
        return float(1.0 / (per_mm * self.focal_length_mm))
