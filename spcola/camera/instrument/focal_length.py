"""Focal lengths that vary: with temperature and with focus."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from spcola.arrays import FloatArray, check_finite, frozen
from spcola.errors import InvalidValueError


@dataclass(frozen=True)
class ThermalFocus:
    """Linear change of the focal length with temperature (Gaskell et al., §2.2).

    ``f(T) = f (1 + per_kelvin (T − reference_c))``.

    Parameters
    ----------
    reference_c : float
        Temperature at which the focal length is nominal, °C.
    per_kelvin : float
        Relative change, 1/K.

    Raises
    ------
    InvalidValueError
        If a number is not finite, or 100 K would change the focal length by half.
    """

    reference_c: float
    per_kelvin: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.reference_c) and abs(self.per_kelvin) < 5e-3):
            raise InvalidValueError(
                f"{self.per_kelvin} per kelvin from {self.reference_c} °C is no law of temperature",
                "focal length",
            )

    def factor(self, temperature_c: float) -> float:
        """Return f(T) / f at `temperature_c`, °C."""
        return 1.0 + self.per_kelvin * (temperature_c - self.reference_c)


@dataclass(frozen=True, eq=False)
class FocusTable:
    """Focal length, and distortion if it changes too, at positions of a focus mechanism.

    Parameters
    ----------
    motor : (N,) array_like
        Positions of the mechanism, increasing.
    inverse_range : (N,) array_like
        One over the distance in focus, 1/m: 0 for infinity; falling with the motor's position.
    focal_length_mm : (N,) array_like
    distortion : (N, K) array_like
        Coefficients of the camera's model; K = 0 if they do not change.

    Raises
    ------
    InvalidValueError
        If shapes differ, a value is not finite, or an order is wrong.
    """

    motor: FloatArray
    inverse_range: FloatArray
    focal_length_mm: FloatArray
    distortion: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        motor = frozen(self.motor, (None,), "focus: motor")
        count = len(motor)
        object.__setattr__(self, "motor", motor)
        for name in ("inverse_range", "focal_length_mm"):
            object.__setattr__(self, name, frozen(getattr(self, name), (count,), f"focus: {name}"))
        table = np.reshape(self.distortion, (count, -1)) if np.size(self.distortion) else None
        rows = np.zeros((count, 0)) if table is None else table
        object.__setattr__(self, "distortion", frozen(rows, (count, None), "focus: distortion"))
        for name in ("motor", "inverse_range", "focal_length_mm", "distortion"):
            check_finite(getattr(self, name), f"focus: {name}")
        if count < 2 or np.any(np.diff(motor) <= 0) or np.any(np.diff(self.inverse_range) >= 0):
            raise InvalidValueError(
                "needs two rows at least, motor positions that rise and ranges that grow", "focus"
            )
        if self.inverse_range[-1] < 0 or np.any(self.focal_length_mm <= 0):
            raise InvalidValueError("has a range or focal length that is not positive", "focus")

    def motor_at(self, range_m: float) -> float:
        """Return the motor's position that focuses at `range_m`, metres; infinity is allowed.

        Linear in one over the range; the end of the table beyond it.
        """
        return float(np.interp(1.0 / range_m, self.inverse_range[::-1], self.motor[::-1]))

    def covers(self, motor: float) -> bool:
        """Return whether the position `motor` lies in the table."""
        return bool(self.motor[0] <= motor <= self.motor[-1])

    def at(self, motor: float) -> tuple[float, FloatArray]:
        """Return focal length, mm, and distortion (K,) at `motor`: linear between rows."""
        focal = float(np.interp(motor, self.motor, self.focal_length_mm))
        columns = [np.interp(motor, self.motor, column) for column in self.distortion.T]
        return focal, np.array(columns, dtype=np.float64)
