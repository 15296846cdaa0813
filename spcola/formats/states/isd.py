"""States in image support data (ISD, JSON) of ALE, for frame cameras and line scanners."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from spcola.errors import FormatError
from spcola.formats.text.source import KM, as_format_error, read_bytes
from spcola.navigation.states import PositionTable, RotationTable, StateSource, StateTables

_J2000 = 1
_TABLES = ("instrument_pointing", "instrument_position", "body_rotation")


def read_isd_states(path: str | Path) -> StateTables:
    """Read pointing, position, rotation of the body and Sun from an ISD file.

    Quaternions are scalar first, from J2000; positions km relative to the body, along J2000, as in
    the tables of ISIS cubes.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        If it is not JSON, a table is missing or has other units, or another reference frame.
    """
    try:
        content = json.loads(read_bytes(path).decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise FormatError(f"is not JSON ({error})", path, "give an ISD file of ALE") from error
    if not isinstance(content, dict):
        raise FormatError("holds no JSON object", path, "give an ISD file of ALE")
    for name in _TABLES:
        if not isinstance(content.get(name), dict):
            raise FormatError(
                f"has no table {name}", path, "write the ISD with ALE in the form of ISIS"
            )
    sun = content.get("sun_position")
    return StateTables(
        _rotation(content, "instrument_pointing", path),
        _position(content, "instrument_position", path),
        _rotation(content, "body_rotation", path),
        _position(content, "sun_position", path) if isinstance(sun, dict) else None,
        StateSource.ISD,
    )


def _rotation(content: Mapping[str, Any], name: str, path: str | Path) -> RotationTable:
    """Return a table of rotations."""
    table, where = content[name], f"{path}, {name}"
    _check_frame(table, where)
    with _numbers(where):
        constant = table.get("constant_rotation")
        return RotationTable(
            table["ephemeris_times"],
            table["quaternions"],
            np.eye(3) if constant is None else np.array(constant, dtype=float).reshape(3, 3),
            where,
        )


def _position(content: Mapping[str, Any], name: str, path: str | Path) -> PositionTable:
    """Return a table of positions."""
    table, where = content[name], f"{path}, {name}"
    _check_frame(table, where)
    if table.get("unit", "km") != "km":
        raise FormatError(f"is in {table['unit']}, not in km", where, "write it with ALE again")
    with _numbers(where):
        velocity = table.get("velocities")
        return PositionTable(
            table["ephemeris_times"],
            KM * np.array(table["positions"], dtype=float),
            None if velocity is None else KM * np.array(velocity, dtype=float),  # type: ignore[arg-type]
            where,
        )


def _check_frame(table: Mapping[str, Any], where: str) -> None:
    """Refuse a table that is not relative to J2000."""
    if table.get("reference_frame", _J2000) != _J2000:
        raise FormatError(
            f"has the reference frame {table['reference_frame']}, not J2000 ({_J2000})", where
        )


@contextmanager
def _numbers(where: str) -> Iterator[None]:
    """Turn errors of missing or wrong numbers into one line."""
    try:
        with as_format_error(where):
            yield
    except KeyError as error:
        raise FormatError(f"has no {error.args[0]}", where, "write it with ALE again") from error
    except (TypeError, ValueError, OverflowError) as error:
        raise FormatError(f"holds no table of numbers ({error})", where) from error
