"""Columns of tables: quantities and units."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from lidar.formats.records.options import LENGTH_UNITS_M
from spcola.arrays import FloatArray
from spcola.errors import FormatError

_ANGLE_UNITS_RAD = {"deg": math.pi / 180.0, "rad": 1.0}
_LENGTHS = ("x", "y", "z", "radius", "range", "scx", "scy", "scz", "scradius", "sigma")
_ANGLES = ("lon", "lat", "sclon", "sclat")
_PLAIN = ("intensity", "flag")

UNITS: Mapping[str, Mapping[str, float]] = {
    **dict.fromkeys(_LENGTHS, LENGTH_UNITS_M),
    **dict.fromkeys(_ANGLES, _ANGLE_UNITS_RAD),
    **{name: {"": 1.0} for name in _PLAIN},
    "time": {"s": 1.0, "utc": math.nan},
}
"""The quantities of columns, and the SI units in each of their units."""

_OTHER_NAMES = {
    "longitude": "lon",
    "latitude": "lat",
    "sc_lon": "sclon",
    "sc_lat": "sclat",
    "sc_radius": "scradius",
    "sc_x": "scx",
    "sc_y": "scy",
    "sc_z": "scz",
    "et": "time",
    "time_et": "time",
}
_WITH_UNIT = re.compile(
    r"(?P<name>.*?)(?:_(?P<a>[a-z]+)|\s*[\[(](?P<b>[a-z]+)[\])])", re.IGNORECASE
)
_ALL_UNITS = {unit for units in UNITS.values() for unit in units if unit}


@dataclass(frozen=True)
class Column:
    """One column that is read.

    Parameters
    ----------
    index : int
        Its place, from 0.
    unit : str
        Its unit; empty for a quantity that has none.
    to_si : float
        SI units in one of its units.
    """

    index: int
    unit: str
    to_si: float

    def si(self, values: FloatArray) -> FloatArray:
        """Return values of the column in SI units."""
        return values * self.to_si


def split_unit(header: str) -> tuple[str, str]:
    """Return the name and the unit in ``x_km``, ``X [km]`` or ``X (km)``; no unit: empty."""
    found = _WITH_UNIT.fullmatch(header.strip())
    unit = (found["a"] or found["b"]).lower() if found else ""
    if found is None or unit not in _ALL_UNITS:
        return header.strip(), ""
    return found["name"].strip(), unit


def quantity_of(header: str) -> tuple[str, str] | None:
    """Return the quantity and unit that a column's header names, None if it is no quantity."""
    if header.strip().lower() in ("utc", "time_utc"):
        return "time", "utc"
    name, unit = split_unit(header)
    name = name.lower()
    if name == "time" and unit == "s":
        # Seconds need an epoch: the header must state that it is ephemeris time.
        unit = ""
    quantity = _OTHER_NAMES.get(name, name)
    return (quantity, unit) if quantity in UNITS else None


def named_columns(headers: list[str], place: str) -> dict[str, Column]:
    """Return the columns of a table by quantity, as named in its header.

    Raises
    ------
    FormatError
        If a column has no unit or an unsuitable one, or two hold the same quantity.
    """
    columns: dict[str, Column] = {}
    for index, header in enumerate(headers):
        named = quantity_of(header)
        if named is None:
            continue
        quantity, unit = named
        if quantity in columns:
            raise FormatError(
                f"column {header!r} repeats {quantity}",
                place,
                f"choose one: columns {{'{quantity}': '{header.strip()}'}}",
            )
        columns[quantity] = _column(quantity, index, unit, header, place)
    return columns


def chosen_columns(headers: list[str], chosen: Mapping[str, str], place: str) -> dict[str, Column]:
    """Return the columns that the user chose; a unit may stand in the header or after the name.

    Raises
    ------
    FormatError
        If a quantity or a column is unknown, or a unit is missing or unsuitable.
    """
    names = [header.strip() for header in headers]
    columns = {}
    for quantity, text in chosen.items():
        if quantity not in UNITS:
            raise FormatError(
                f"{quantity!r} is no quantity of a return", "columns", f"use {', '.join(UNITS)}"
            )
        name, unit = split_unit(text)
        found = text.strip() if text.strip() in names else name
        if names.count(found) != 1:
            problem = "has no" if found not in names else "has more than one"
            raise FormatError(
                f"{problem} column {found!r}", place, f"its columns are {', '.join(names)}"
            )
        index = names.index(found)
        columns[quantity] = _column(quantity, index, unit or split_unit(found)[1], text, place)
    return columns


def _column(quantity: str, index: int, unit: str, header: str, place: str) -> Column:
    units = UNITS[quantity]
    if unit not in units:
        problem = f"is in {unit!r}" if unit else "has no unit"
        wanted = " or ".join(units)
        example = "utc or time_et_s" if quantity == "time" else f"{quantity}_{next(iter(units))}"
        raise FormatError(
            f"column {header.strip()!r} {problem}, {quantity} needs {wanted}",
            place,
            f"name it {example}, or state columns {{'{quantity}': '{header.strip()} "
            f"[{next(iter(units))}]'}}",
        )
    return Column(index, unit, units[unit])
