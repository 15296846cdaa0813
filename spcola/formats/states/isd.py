"""States in image support data (ISD, JSON) of ALE, for frame cameras and line scanners."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import FormatError
from spcola.formats.text.fields import Fields
from spcola.formats.text.source import KM, as_format_error
from spcola.navigation.states import PositionTable, RotationTable, StateSource, StateTables

_J2000 = 1
_SUN = "sun_position"


def read_isd_states(path: str | Path) -> StateTables:
    """Read pointing, position, rotation of the body and Sun from an ISD file.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        If it is not JSON, or as :func:`isd_states`.
    """
    return isd_states(Fields.read_json(path))


def isd_states(fields: Fields) -> StateTables:
    """Return the states in the content of an ISD file.

    Quaternions are scalar first, from J2000; positions km relative to the body, along J2000, as in
    the tables of ISIS cubes.

    Parameters
    ----------
    fields : Fields

    Raises
    ------
    FormatError
        If a table is missing or has other units, or another reference frame.
    """
    return StateTables(
        _rotation(fields, "instrument_pointing"),
        _position(fields, "instrument_position"),
        _rotation(fields, "body_rotation"),
        None if fields.get(_SUN) is None else _position(fields, _SUN),
        StateSource.ISD,
    )


def _rotation(fields: Fields, name: str) -> RotationTable:
    """Return a table of rotations."""
    times = _times(fields, name)
    constant: FloatArray = np.eye(3)
    if fields.get(f"{name}.constant_rotation") is not None:
        constant = fields.vector(f"{name}.constant_rotation", 9).reshape(3, 3)
    where = fields.where(name)
    with as_format_error():
        return RotationTable(times, _rows(fields, f"{name}.quaternions", times, 4), constant, where)


def _position(fields: Fields, name: str) -> PositionTable:
    """Return a table of positions."""
    times = _times(fields, name)
    unit = fields.text(f"{name}.unit", "km")
    if unit != "km":
        raise FormatError(f"is in {unit}, not in km", fields.where(name), "write it with ALE again")
    positions = KM * _rows(fields, f"{name}.positions", times, 3)
    rates = f"{name}.velocities"
    velocity = np.full_like(positions, np.nan)
    if fields.get(rates) is not None:
        velocity = KM * _rows(fields, rates, times, 3)
    where = fields.where(name)
    with as_format_error():
        return PositionTable(times, positions, velocity, where)


def _times(fields: Fields, name: str) -> FloatArray:
    """Return the times of a table, which must be relative to J2000."""
    if fields.get(name) is None:
        raise FormatError(
            "is missing", fields.where(name), "write the ISD with ALE in the form of ISIS"
        )
    frame = fields.number(f"{name}.reference_frame", _J2000)
    if frame != _J2000:
        raise FormatError(
            f"is {frame:g}, not J2000 ({_J2000})", fields.where(f"{name}.reference_frame")
        )
    return fields.vector(f"{name}.ephemeris_times")


def _rows(fields: Fields, name: str, times: FloatArray, width: int) -> FloatArray:
    """Return rows (N, width), one for each time."""
    rows = fields.table(name, width)
    if len(rows) != len(times):
        raise FormatError(f"has {len(rows)} rows for {len(times)} times", fields.where(name))
    return rows
