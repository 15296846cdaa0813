"""Tables of poses (CSV with a header): columns are recognised by their names.

==================  ==============================================================================
name                ``image``, ``name``, ``file`` or ``picture``
time                ``et``, or ``utc`` or ``time`` (the middle of the exposure)
position            ``v0x v0y v0z`` (from the camera to the body's origin) or ``scx scy scz`` (the
                    other way), each with ``_km`` or ``_m``
attitude            ``cxx cxy cxz cyx … czz`` (rows Cx, Cy, Cz); or ``qw qx qy qz`` (quaternion that
                    takes coordinates to the camera's); or ``ra_deg dec_deg twist_deg``
Sun                 ``sunx suny sunz`` (to the Sun, of any length); may be missing
uncertainty         ``sigma_v0x`` … with ``_km`` or ``_m``; ``sigma_cx_rad`` …; may be missing
==================  ==============================================================================

Vectors and attitudes are body-fixed, or along J2000 where the names end in ``_j2000``
(``scx_km_j2000``, ``qw_j2000``); right ascension, declination and twist always are. The rows of the
camera's axes are ``R_z(twist) R_x(90° − Dec) R_z(90° + RA)``.

An image has one row. One whose lines were exposed one after the other has several: states at their
times, or, with a column ``line``, at these lines of the image (1 is the first).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from spcola.arrays import FloatArray
from spcola.errors import FormatError
from spcola.formats.states.columns import Row, image_lines
from spcola.formats.states.pose_rows import PoseRows
from spcola.formats.text.source import KM, as_format_error
from spcola.navigation import Spin
from spcola.navigation.states import ImageState, StateSource

_UNITS = {"_km": KM, "_m": 1.0}
_XYZ = ("x", "y", "z")
_J2000 = "_j2000"
_UNIT = 1e-5


def read_poses(
    path: str | Path,
    *,
    columns: Mapping[str, str] | None = None,
    spin: Spin | None = None,
) -> dict[str, PoseRows]:
    """Read the states of images from a table, by their names, in the order of the file.

    Parameters
    ----------
    path : str or Path
    columns : mapping of str to str, optional
        For names of this module, those in the file: ``{"scx_m": "X"}``.
    spin : Spin, optional
        Rotation of the body, for vectors along J2000.

    Raises
    ------
    FormatError
        If a column is missing, a value is no number or time, or the table is inertial and no
        rotation is given.
    """
    found = {}
    for name, rows in image_lines(path, columns or {}).items():
        lines = [row.numbers(("line",)) for row in rows]
        at = None if lines[0] is None else np.array(lines, dtype=np.float64)[:, 0]
        states = tuple(_state(name, row, spin) for row in rows)
        found[name] = PoseRows(states, at, tuple(row.place for row in rows))
    return found


@dataclass(frozen=True)
class _Vector:
    """Three numbers in metres (or without unit), and whether they are along J2000."""

    values: FloatArray
    inertial: bool


def _vector(row: Row, names: Sequence[str], units: Mapping[str, float]) -> _Vector | None:
    """Return numbers whose columns may end in a unit and ``_j2000``."""
    found = []
    for end, inertial in (("", False), (_J2000, True)):
        for unit, factor in units.items():
            values = row.numbers([f"{name}{unit}{end}" for name in names])
            if values is not None:
                found.append(_Vector(factor * values, inertial))
    if len(found) > 1:
        raise FormatError(f"states {names[0]} … twice", row.place, "remove some columns")
    return found[0] if found else None


def _state(name: str, row: Row, spin: Spin | None) -> ImageState:
    """Return the state on one line."""
    time = row.time_or_nan()
    position, attitude, sun = _position(row), _attitude(row), _sun(row)
    turn: FloatArray = np.eye(3)
    if position.inertial or attitude.inertial or (sun is not None and sun.inertial):
        turn = _turn(row, spin, time)
    with as_format_error(row.place):
        state = ImageState(
            name,
            time,
            turn @ position.values if position.inertial else position.values,
            attitude.values @ turn.T if attitude.inertial else attitude.values,
            StateSource.POSES,
            scobj_sigma=_sigma(row, "v0", _UNITS),
            pointing_sigma=_sigma(row, "c", {"_rad": 1.0}),
        )
        if sun is None:
            return state
        return replace(state, sun=turn @ sun.values if sun.inertial else sun.values)


def _turn(row: Row, spin: Spin | None, time: float) -> FloatArray:
    """Return the matrix (3, 3) from J2000 to the body-fixed frame."""
    if spin is None or not np.isfinite(time):
        lacks = "the rotation of the body" if spin is None else "the time"
        raise FormatError(f"is along J2000, and {lacks} is not stated", row.place)
    turn: FloatArray = spin.axes([time])[0]
    return turn


def _position(row: Row) -> _Vector:
    """Return V0, metres."""
    toward = _vector(row, [f"v0{axis}" for axis in _XYZ], _UNITS)
    away = _vector(row, [f"sc{axis}" for axis in _XYZ], _UNITS)
    if (toward is None) == (away is None):
        raise FormatError(
            "states no position, or two",
            row.place,
            "name columns v0x_km v0y_km v0z_km or scx_km scy_km scz_km (or _m)",
        )
    if toward is not None:
        return toward
    assert away is not None
    return _Vector(-away.values, away.inertial)


def _attitude(row: Row) -> _Vector:
    """Return the axes (3, 3)."""
    plain = {"": 1.0}
    axes = _vector(row, [f"c{i}{j}" for i in _XYZ for j in _XYZ], plain)
    quaternion = _vector(row, ["qw", "qx", "qy", "qz"], plain)
    angles = row.numbers(("ra_deg", "dec_deg", "twist_deg"))
    if sum(given is not None for given in (axes, quaternion, angles)) != 1:
        raise FormatError(
            "states no attitude, or two",
            row.place,
            "name columns cxx … czz, or qw qx qy qz, or ra_deg dec_deg twist_deg",
        )
    if axes is not None:
        return _Vector(axes.values.reshape(3, 3), axes.inertial)
    if quaternion is not None:
        if not abs(np.linalg.norm(quaternion.values) - 1.0) < _UNIT:
            raise FormatError("the quaternion is not of unit length", row.place)
        turned = Rotation.from_quat(quaternion.values[[1, 2, 3, 0]]).as_matrix()
        return _Vector(turned, quaternion.inertial)
    assert angles is not None
    return _Vector(axes_of_pointing(*angles), True)


def axes_of_pointing(ra_deg: float, dec_deg: float, twist_deg: float) -> FloatArray:
    """Return the rows Cx, Cy, Cz (3, 3) along J2000 of a boresight and a twist, degrees.

    The twist runs from the east to Cx, towards the north.
    """
    turns = [90.0 + ra_deg, 90.0 - dec_deg, twist_deg]
    axes: FloatArray = Rotation.from_euler("ZXZ", turns, degrees=True).as_matrix().T
    return axes


def _sun(row: Row) -> _Vector | None:
    """Return the unit vector to the Sun."""
    sun = _vector(row, [f"sun{axis}" for axis in _XYZ], {"": 1.0, **_UNITS})
    if sun is None:
        return None
    length = float(np.linalg.norm(sun.values))
    if length == 0.0:
        raise FormatError("the vector to the Sun is zero", row.place)
    return _Vector(sun.values / length, sun.inertial)


def _sigma(row: Row, stem: str, units: Mapping[str, float]) -> FloatArray:
    """Return standard deviations (3,); NaN if not stated."""
    found = _vector(row, [f"sigma_{stem}{axis}" for axis in _XYZ], units)
    return np.full(3, np.nan) if found is None else found.values
