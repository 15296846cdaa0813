"""Tables of poses (CSV with a header): one image a line, columns recognised by their names.

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
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from spcola.arrays import FloatArray
from spcola.errors import FormatError
from spcola.formats.text.source import KM, as_format_error, read_bytes
from spcola.navigation import Spin, et_from_utc
from spcola.navigation.states import ImageState, StateSource

_NAMES = ("image", "name", "file", "picture")
_UTC = ("utc", "time")
_UNITS = {"_km": KM, "_m": 1.0}
_XYZ = ("x", "y", "z")
_J2000 = "_j2000"
_UNIT = 1e-5


def read_poses(
    path: str | Path,
    *,
    columns: Mapping[str, str] | None = None,
    spin: Spin | None = None,
) -> list[ImageState]:
    """Read the states of images from a table.

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
        If a column is missing, a value is no number or time, an image appears twice, or the table
        is inertial and no rotation is given.
    """
    header, rows = _read(Path(path), columns or {})
    found: dict[str, ImageState] = {}
    for number, words in rows:
        place = f"{path}, line {number}"
        state = _state(_Row(place, dict(zip(header, words, strict=True))), spin)
        if state.name in found:
            raise FormatError(f"{state.name} appears twice", place, "remove one line")
        found[state.name] = state
    if not found:
        raise FormatError("holds no image", path, "give a table with a line for each image")
    return list(found.values())


def _read(
    path: Path, columns: Mapping[str, str]
) -> tuple[list[str], list[tuple[int, Sequence[str]]]]:
    """Return the names of the columns, and number and words of each line."""
    lines = read_bytes(path).decode("utf-8-sig", "backslashreplace").splitlines()
    delimiter = max(",;\t", key=lines[0].count)
    reader = csv.reader(lines, delimiter=delimiter)
    given = [name.strip() for name in next(reader)]
    for wanted, name in columns.items():
        if name not in given:
            raise FormatError(
                f"has no column {name!r} for {wanted}", path, f"it has {', '.join(given)}"
            )
    renamed = {name: wanted for wanted, name in columns.items()}
    header = [renamed.get(name, name).lower() for name in given]
    if len(set(header)) < len(header):
        raise FormatError("has two columns of one name", path, "rename one")
    rows: list[tuple[int, Sequence[str]]] = []
    for words in reader:
        if not any(word.strip() for word in words):
            continue
        if len(words) != len(header):
            raise FormatError(
                f"has {len(words)} values for {len(header)} columns",
                f"{path}, line {reader.line_num}",
            )
        rows.append((reader.line_num, words))
    return header, rows


@dataclass(frozen=True)
class _Vector:
    """Three numbers in metres (or without unit), and whether they are along J2000."""

    values: FloatArray
    inertial: bool


@dataclass(frozen=True)
class _Row:
    """A line of the table."""

    place: str
    words: Mapping[str, str]

    def text(self, names: Sequence[str]) -> str | None:
        """Return the word of the first of some columns; None if there is none of them."""
        return next((self.words[name].strip() for name in names if name in self.words), None)

    def numbers(self, names: Sequence[str]) -> FloatArray | None:
        """Return the numbers of columns; None if none of them is there."""
        missing = [name for name in names if name not in self.words]
        if len(missing) == len(names):
            return None
        if missing:
            raise FormatError(f"has no column {missing[0]}", self.place, "complete the table")
        try:
            values = np.array([float(self.words[name]) for name in names])
        except ValueError as error:
            raise FormatError(f"{error}", self.place) from error
        if not np.isfinite(values).all():
            raise FormatError(f"{names[0]} … holds a value that is not finite", self.place)
        return values

    def vector(self, names: Sequence[str], units: Mapping[str, float]) -> _Vector | None:
        """Return numbers whose columns may end in a unit and ``_j2000``."""
        found = []
        for end, inertial in (("", False), (_J2000, True)):
            for unit, factor in units.items():
                values = self.numbers([f"{name}{unit}{end}" for name in names])
                if values is not None:
                    found.append(_Vector(factor * values, inertial))
        if len(found) > 1:
            raise FormatError(f"states {names[0]} … twice", self.place, "remove some columns")
        return found[0] if found else None


def _state(row: _Row, spin: Spin | None) -> ImageState:
    """Return the state on one line."""
    name = row.text(_NAMES)
    if not name:
        raise FormatError("names no image", row.place, f"name a column {_NAMES[0]}")
    time = _time(row)
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


def _time(row: _Row) -> float:
    """Return the ephemeris time, s; NaN if there is no column for it."""
    seconds = row.numbers(("et",))
    if seconds is not None:
        return float(seconds[0])
    utc = row.text(_UTC)
    if utc is None:
        return float("nan")
    try:
        return et_from_utc(utc)
    except FormatError as error:
        raise FormatError(error.what, row.place) from error


def _turn(row: _Row, spin: Spin | None, time: float) -> FloatArray:
    """Return the matrix (3, 3) from J2000 to the body-fixed frame."""
    if spin is None or not np.isfinite(time):
        lacks = "the rotation of the body" if spin is None else "the time"
        raise FormatError(f"is along J2000, and {lacks} is not stated", row.place)
    turn: FloatArray = spin.axes([time])[0]
    return turn


def _position(row: _Row) -> _Vector:
    """Return V0, metres."""
    toward = row.vector([f"v0{axis}" for axis in _XYZ], _UNITS)
    away = row.vector([f"sc{axis}" for axis in _XYZ], _UNITS)
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


def _attitude(row: _Row) -> _Vector:
    """Return the axes (3, 3)."""
    plain = {"": 1.0}
    axes = row.vector([f"c{i}{j}" for i in _XYZ for j in _XYZ], plain)
    quaternion = row.vector(["qw", "qx", "qy", "qz"], plain)
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
    ra, dec, twist = angles
    frame = Rotation.from_euler("ZXZ", [90.0 + ra, 90.0 - dec, twist], degrees=True)
    return _Vector(frame.as_matrix().T, True)


def _sun(row: _Row) -> _Vector | None:
    """Return the unit vector to the Sun."""
    sun = row.vector([f"sun{axis}" for axis in _XYZ], {"": 1.0, **_UNITS})
    if sun is None:
        return None
    length = float(np.linalg.norm(sun.values))
    if length == 0.0:
        raise FormatError("the vector to the Sun is zero", row.place)
    return _Vector(sun.values / length, sun.inertial)


def _sigma(row: _Row, stem: str, units: Mapping[str, float]) -> FloatArray:
    """Return standard deviations (3,); NaN if not stated."""
    found = row.vector([f"sigma_{stem}{axis}" for axis in _XYZ], units)
    return np.full(3, np.nan) if found is None else found.values
