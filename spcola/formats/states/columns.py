"""Tables (CSV with a header) with a line for each image: columns by their names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import FormatError
from spcola.formats.text import parse_number, read_words
from spcola.navigation import et_from_utc

NAMES = ("image", "name", "file", "picture")
"""Columns that name the image."""


@dataclass(frozen=True)
class Row:
    """A line of the table."""

    place: str
    words: Mapping[str, str]

    def text(self, names: Sequence[str]) -> str | None:
        """Return the word of the first of some columns; None if there is none of them."""
        return next((self.words[name] for name in names if name in self.words), None)

    def numbers(self, names: Sequence[str]) -> FloatArray | None:
        """Return the numbers of columns; None if none of them is there."""
        missing = [name for name in names if name not in self.words]
        if len(missing) == len(names):
            return None
        if missing:
            raise FormatError(f"has no column {missing[0]}", self.place, "complete the table")
        return np.array([self._number(name) for name in names])

    def _number(self, name: str) -> float:
        try:
            return parse_number(self.words[name])
        except ValueError as error:
            raise FormatError(f"{error}", f"{self.place}, column {name}") from error

    def time(self) -> float | None:
        """Return the ephemeris time, s: column ``et``, ``utc`` or ``time``; None without them."""
        seconds = self.numbers(("et",))
        if seconds is not None:
            return float(seconds[0])
        text = self.text(("utc", "time"))
        if text is None:
            return None
        try:
            return et_from_utc(text)
        except FormatError as error:
            raise FormatError(error.what, self.place) from error

    def time_or_nan(self) -> float:
        """Return the ephemeris time, s; NaN if there is none."""
        time = self.time()
        return float("nan") if time is None else time


def image_rows(path: str | Path, columns: Mapping[str, str]) -> dict[str, Row]:
    """Return the line of each image, by its name, in the order of the file.

    As :func:`image_lines`; an image that appears twice is refused.
    """
    found = image_lines(path, columns)
    for image, rows in found.items():
        if len(rows) > 1:
            raise FormatError(f"{image} appears twice", rows[1].place, "remove one line")
    return {image: rows[0] for image, rows in found.items()}


def image_lines(path: str | Path, columns: Mapping[str, str]) -> dict[str, list[Row]]:
    """Return the lines of each image, by its name, in the order of the file.

    Parameters
    ----------
    path : str or Path
    columns : mapping of str to str
        For names of columns, those in the file.

    Raises
    ------
    FormatError
        If the table has no image, or a line has too many or few words or names no image.
    """
    table = read_words(path)
    for wanted, name in columns.items():
        if name not in table.names:
            raise FormatError(
                f"has no column {name!r} for {wanted}", path, f"it has {', '.join(table.names)}"
            )
    renamed = {name: wanted for wanted, name in columns.items()}
    header = [renamed.get(name, name).lower() for name in table.names]
    if len(set(header)) < len(header):
        raise FormatError("has two columns of one name", path, "rename one")
    found: dict[str, list[Row]] = {}
    for number, words in zip(table.lines, table.rows, strict=True):
        row = Row(f"{path}, line {number}", dict(zip(header, words, strict=True)))
        image = row.text(NAMES)
        if not image:
            raise FormatError("names no image", row.place, f"name a column {NAMES[0]}")
        found.setdefault(image, []).append(row)
    return found
