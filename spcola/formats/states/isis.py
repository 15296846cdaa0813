"""States in the tables of ISIS cubes: InstrumentPointing, InstrumentPosition, BodyRotation, Sun.

``spiceinit`` writes them. Rotations are quaternions, scalar first, from J2000 to a frame that turns
with time, followed by a constant matrix to the camera (or to the body-fixed frame). Positions are
km relative to the centre of the body, along J2000; light time and aberration are in them.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import FormatError
from spcola.formats.images.isis_tables import IsisTable, read_isis_tables
from spcola.formats.text.source import KM, as_format_error
from spcola.navigation.states import PositionTable, RotationTable, StateSource, StateTables

_QUATERNION = ("J2000Q0", "J2000Q1", "J2000Q2", "J2000Q3")
_POSITION = ("J2000X", "J2000Y", "J2000Z")
_VELOCITY = ("J2000XV", "J2000YV", "J2000ZV")


def read_isis_states(path: str | Path) -> StateTables:
    """Read the states in the tables of a cube.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        If it is no cube, or as :func:`isis_states`.
    """
    return isis_states(read_isis_tables(path), str(path))


def isis_states(tables: Mapping[str, IsisTable], where: str) -> StateTables:
    """Return the states in the tables of a cube.

    Parameters
    ----------
    tables : mapping of str to IsisTable
        By name.
    where : str
        The cube, for messages.

    Raises
    ------
    FormatError
        If a table is missing, has other columns (polynomials of a bundle adjustment), or values
        that are no rotation or position.
    """
    for name in ("InstrumentPointing", "InstrumentPosition", "BodyRotation"):
        if name not in tables:
            raise FormatError(f"has no table {name}", where, "run spiceinit on the cube")
    sun = tables.get("SunPosition")
    return StateTables(
        _rotation(tables["InstrumentPointing"], f"{where}, InstrumentPointing"),
        _position(tables["InstrumentPosition"], f"{where}, InstrumentPosition"),
        _rotation(tables["BodyRotation"], f"{where}, BodyRotation"),
        None if sun is None else _position(sun, f"{where}, SunPosition"),
        StateSource.ISIS,
    )


def _rotation(table: IsisTable, where: str) -> RotationTable:
    """Return a table of rotations."""
    constant = table.keywords.get("ConstantRotation")
    with as_format_error():
        matrix = np.eye(3) if constant is None else np.array(constant, dtype=float)
        if matrix.size != 9:
            raise FormatError(f"ConstantRotation has {matrix.size} numbers, not 9", where)
        return RotationTable(
            _columns(table, ("ET",), where)[:, 0],
            _columns(table, _QUATERNION, where),
            matrix.reshape(3, 3),
            where,
        )


def _position(table: IsisTable, where: str) -> PositionTable:
    """Return a table of positions."""
    known = all(name in table.columns for name in _VELOCITY)
    with as_format_error():
        return PositionTable(
            _columns(table, ("ET",), where)[:, 0],
            KM * _columns(table, _POSITION, where),
            KM * _columns(table, _VELOCITY, where) if known else None,  # type: ignore[arg-type]
            where,
        )


def _columns(table: IsisTable, names: tuple[str, ...], where: str) -> FloatArray:
    """Return columns (N, len(names))."""
    for name in names:
        if name not in table.columns:
            raise FormatError(
                f"has no column {name}, but {', '.join(table.columns)}",
                where,
                "polynomials are not read: run spiceinit on the cube again",
            )
    return np.column_stack([np.asarray(table.columns[name], dtype=float) for name in names])
