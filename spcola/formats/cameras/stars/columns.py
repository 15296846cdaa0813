"""Tables of named columns in text (CSV, tabs or blanks), with their place in errors."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import FormatError
from spcola.formats.text import parse_number, read_bytes

_WORDS = re.compile(r"[^a-z0-9]+")


@dataclass(frozen=True)
class NamedColumns:
    """Rows of words under the names of a header line.

    Parameters
    ----------
    path : Path
    names : tuple of str
        In small letters, without signs.
    rows : tuple of tuple of str
    lines : tuple of int
        Number of each row's line in the file, from 1.
    """

    path: Path
    names: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]

    def find(self, aliases: Sequence[str]) -> int | None:
        """Return the place of the first of several names, or None."""
        return next((self.names.index(name) for name in aliases if name in self.names), None)

    def texts(self, aliases: Sequence[str]) -> list[str] | None:
        """Return a column's words, or None if there is none of these names."""
        place = self.find(aliases)
        return None if place is None else [row[place] for row in self.rows]

    def numbers(self, aliases: Sequence[str], *, default: float | None = None) -> FloatArray:
        """Return a column's numbers (N,).

        Raises
        ------
        FormatError
            If there is no such column and no default, or a word is no number.
        """
        place = self.find(aliases)
        if place is None:
            if default is None:
                raise FormatError(
                    f"has no column {' or '.join(aliases)}; it has {', '.join(self.names)}",
                    self.path,
                )
            return np.full(len(self.rows), default)
        return np.array(
            [
                self._number(row[place], line)
                for row, line in zip(self.rows, self.lines, strict=True)
            ]
        )

    def _number(self, word: str, line: int) -> float:
        try:
            return parse_number(word)
        except ValueError as error:
            raise FormatError(str(error), f"{self.path}, line {line}") from error


def read_columns(path: str | Path) -> NamedColumns:
    """Read a table whose first line has the columns' names; lines that begin with # are left out.

    Separated by commas, semicolons, tabs or blanks, whichever the header has.

    Raises
    ------
    FormatError
        If the file cannot be read, is no text, or has no rows, or a line has another number of
        columns than the header.
    """
    try:
        text = read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FormatError(f"is not text ({error.reason})", path) from error
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if len(lines) < 2:
        raise FormatError("has no header and rows", path)
    mark = next((mark for mark in ",;\t" if mark in lines[0][1]), None)
    split = [(number, _words(line, mark)) for number, line in lines]
    names = tuple(_WORDS.sub("", name.lower()) for name in split[0][1])
    for number, row in split[1:]:
        if len(row) != len(names):
            raise FormatError(
                f"has {len(row)} columns, the header {len(names)}", f"{path}, line {number}"
            )
    rows, numbers = tuple(row for _, row in split[1:]), tuple(number for number, _ in split[1:])
    return NamedColumns(Path(path), names, rows, numbers)


def _words(line: str, mark: str | None) -> tuple[str, ...]:
    if mark is None:
        return tuple(line.split())
    try:
        return tuple(word.strip() for word in next(csv.reader([line], delimiter=mark)))
    except csv.Error:
        return tuple(word.strip() for word in line.split(mark))


def by_value(keys: Sequence[str]) -> Mapping[str, list[int]]:
    """Return the places of each key, in the order of their first appearance."""
    found: dict[str, list[int]] = {}
    for place, key in enumerate(keys):
        found.setdefault(key, []).append(place)
    return found
