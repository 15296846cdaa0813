"""Tables (CSV with a header) with a line for each image: columns by their names."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import FormatError
from spcola.formats.text.source import read_bytes
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

    def time(self, utc: Sequence[str]) -> float | None:
        """Return the ephemeris time, s, of the column ``et`` or of UTC; None if there is none."""
        seconds = self.numbers(("et",))
        if seconds is not None:
            return float(seconds[0])
        text = self.text(utc)
        if text is None:
            return None
        try:
            return et_from_utc(text)
        except FormatError as error:
            raise FormatError(error.what, self.place) from error


def image_rows(path: str | Path, columns: Mapping[str, str]) -> dict[str, Row]:
    """Return the line of each image, by its name, in the order of the file.

    Parameters
    ----------
    path : str or Path
    columns : mapping of str to str
        For names of columns, those in the file.

    Raises
    ------
    FormatError
        If the table has no image, a line has too many or few words or names no image, or an image
        appears twice.
    """
    header, lines = _read(Path(path), columns)
    found: dict[str, Row] = {}
    for number, words in lines:
        row = Row(f"{path}, line {number}", dict(zip(header, words, strict=True)))
        name = row.text(NAMES)
        if not name:
            raise FormatError("names no image", row.place, f"name a column {NAMES[0]}")
        if name in found:
            raise FormatError(f"{name} appears twice", row.place, "remove one line")
        found[name] = row
    if not found:
        raise FormatError("holds no image", path, "give a table with a line for each image")
    return found


def _read(
    path: Path, columns: Mapping[str, str]
) -> tuple[list[str], list[tuple[int, Sequence[str]]]]:
    """Return the names of the columns, and number and words of each line."""
    lines = read_bytes(path).decode("utf-8-sig", "backslashreplace").splitlines()
    delimiter = max(",;\t", key=lines[0].count)
    reader = csv.reader(lines, delimiter=delimiter)
    given = [name.strip() for name in next(_words(reader, path))]
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
    for words in _words(reader, path):
        if not any(word.strip() for word in words):
            continue
        if len(words) != len(header):
            raise FormatError(
                f"has {len(words)} values for {len(header)} columns",
                f"{path}, line {reader.line_num}",
            )
        rows.append((reader.line_num, words))
    return header, rows


def _words(reader: Any, path: Path) -> Iterator[list[str]]:
    """Yield the words of each line of a reader of the module `csv`."""
    try:
        yield from reader
    except csv.Error as error:
        raise FormatError(f"is no table ({error})", f"{path}, line {reader.line_num}") from error
