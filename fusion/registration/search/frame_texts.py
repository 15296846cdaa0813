"""Placements in words: rotated about an axis, mirrored, in another unit, shifted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from fusion.registration.search.closest import Placement
from spcola.arrays import FloatArray

Change = Literal["unit", "mirror", "turn", "scale", "shift"]

UNITS: Mapping[float, str] = MappingProxyType(
    {
        1.0: "",
        1e3: "kilometres for metres",
        1e-3: "millimetres for metres",
        1e-2: "centimetres for metres",
        0.3048: "feet for metres",
        1.0 / 0.3048: "metres taken for feet once more",
    }
)
"""Factors by which lengths may have to be multiplied, and the confusion of units they mean."""

LEAST_TURN_DEG = 0.3
"""Rotations below this are not named: registration finds them."""
# Scale and shift are named beyond this many misfits at the surface, and these shares of the radius.
_MISFITS, _LEAST_SCALE, _LEAST_SHIFT = 2.0, 3e-3, 2e-3
# An axis counts as an axis of the frame if this changes no vector by more than this, degrees.
_ALONG_DEG = 1.0
_AXES = "XYZ"


@dataclass(frozen=True, eq=False)
class FrameChange:
    """Change that makes the lidar fit, in this order: mirror, rotate, scale, shift.

    Attributes
    ----------
    changes : tuple of {"unit", "mirror", "turn", "scale", "shift"}
        The parts that are not negligible; empty if the lidar fits as it is.
    mirrored : str
        The mirrored axis, "X", "Y" or "Z"; empty for none. The one that leaves the smallest
        rotation.
    angle_deg : float
        Of the rotation, by the right-hand rule; negative about −X, −Y or −Z.
    axis : (3,) ndarray
        Of the rotation, unit vector.
    unit : float
        The factor of :data:`UNITS` that is nearest to the scale.
    scale : float
        The remaining scale.
    shift_m : (3,) ndarray
        Metres, in the SPC frame.
    text : str
        A clause with the lidar as its subject.
    """

    changes: tuple[Change, ...]
    mirrored: str
    angle_deg: float
    axis: FloatArray
    unit: float
    scale: float
    shift_m: FloatArray
    text: str

    def as_json(self) -> dict[str, Any]:
        """Return it in JSON types."""
        return {
            "changes": list(self.changes),
            "mirrored": self.mirrored,
            "angle_deg": self.angle_deg,
            "axis": self.axis.tolist(),
            "unit": self.unit,
            "remaining_scale": self.scale,
            "text": self.text,
        }


def frame_change(at: Placement, radius: float, misfit: float) -> FrameChange:
    """Describe a placement of a body of a `radius`, metres, in words.

    Changes that move the surface by less than twice `misfit`, metres, are not named.
    """
    mirrored, rotation = _unmirrored(at.matrix)
    angle, axis, name = _turn(rotation)
    unit = min(UNITS, key=lambda factor: abs(np.log(at.scale / factor)))
    scale = at.scale / unit
    phrases: dict[Change, str] = {}
    if mirrored:
        west = " (longitudes of the other sign)" if mirrored == "Y" else ""
        phrases["mirror"] = f"mirrored in {mirrored}{west}"
    if abs(angle) >= LEAST_TURN_DEG:
        phrases["turn"] = f"turned by {_signed(angle, 1)}° about {name}{_reordered(at.matrix)}"
    if unit != 1.0:
        phrases["unit"] = f"multiplied by {unit:.4g} ({UNITS[unit]})"
    if abs(scale - 1.0) >= max(_LEAST_SCALE, _MISFITS * misfit / radius):
        phrases["scale"] = f"multiplied by {scale:.4f}"
    if np.linalg.norm(at.translation) >= max(_LEAST_SHIFT * radius, _MISFITS * misfit):
        shift = ", ".join(_signed(float(part), 2) for part in at.translation)
        phrases["shift"] = f"shifted by ({shift}) m"
    words = list(phrases.values())
    listed = " and ".join([", ".join(words[:-1]), words[-1]] if words[1:] else words)
    text = f"fits when {listed}" if words else "fits as it is"
    return FrameChange(tuple(phrases), mirrored, angle, axis, unit, scale, at.translation, text)


def _unmirrored(matrix: FloatArray) -> tuple[str, FloatArray]:
    """Axis to mirror first, empty for none, and the rotation (3, 3) that follows."""
    if np.linalg.det(matrix) > 0.0:
        return "", matrix
    flips = [matrix @ (np.eye(3) - 2.0 * np.diag(row)) for row in np.eye(3)]
    best = int(np.argmax([np.trace(flip) for flip in flips]))
    return _AXES[best], flips[best]


def _turn(rotation: FloatArray) -> tuple[float, FloatArray, str]:
    """Angle, degrees, axis and its name."""
    vector = Rotation.from_matrix(rotation).as_rotvec()
    size = float(np.linalg.norm(vector))
    if size == 0.0:
        return 0.0, np.array([0.0, 0.0, 1.0]), "Z"
    axis = vector / size
    main = int(np.argmax(np.abs(axis)))
    sign = float(np.sign(axis[main]))
    # Largest change of a unit vector if the axis is replaced by that of the frame.
    off = 2.0 * np.sin(size / 2.0) * np.sqrt(max(0.0, 1.0 - axis[main] ** 2))
    if np.degrees(off) <= _ALONG_DEG:
        return float(np.degrees(size)) * sign, sign * axis, _AXES[main]
    return float(np.degrees(size)), axis, f"({', '.join(_signed(float(c), 2) for c in axis)})"


def _reordered(matrix: FloatArray) -> str:
    """Describe a rotation as a permutation of axes, if it is one; else empty."""
    order = np.argmax(matrix, axis=1)
    if (order == np.arange(3)).all() or matrix[np.arange(3), order].min() < np.cos(
        np.radians(_ALONG_DEG)
    ):
        return ""
    return f" (its axes {', '.join(_AXES[k] for k in order)} taken as X, Y, Z)"


def _signed(value: float, digits: int) -> str:
    """Return a number with a true minus sign; no minus before zero."""
    text = f"{value:.{digits}f}"
    return text.lstrip("-") if float(text) == 0.0 else text.replace("-", "−")
