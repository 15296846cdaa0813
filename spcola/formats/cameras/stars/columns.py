"""Columns of tables of stars, by their names."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import FormatError
from spcola.formats.text import WordTable, parse_number, read_words

_SIGNS = re.compile(r"[^a-z0-9]+")


class NamedColumns(WordTable):
    """Rows of words under names in small letters, without signs."""

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
    """Read a table (:func:`spcola.formats.text.read_words`)."""
    table = read_words(path)
    names = tuple(_SIGNS.sub("", name.lower()) for name in table.names)
    return NamedColumns(table.path, names, table.rows, table.lines)


def by_value(keys: Sequence[str]) -> Mapping[str, list[int]]:
    """Return the places of each key, in the order of their first appearance."""
    found: dict[str, list[int]] = {}
    for place, key in enumerate(keys):
        found.setdefault(key, []).append(place)
    return found
