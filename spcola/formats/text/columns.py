"""Tables of words under a header line: CSV, semicolons, tabs or blanks."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

from spcola.errors import FormatError
from spcola.formats.text.source import read_bytes


@dataclass(frozen=True)
class WordTable:
    """Rows of words.

    Parameters
    ----------
    path : Path
    names : tuple of str
        Words of the header.
    rows : tuple of tuple of str
        As many words each.
    lines : tuple of int
        Number of each row's line in the file, from 1.
    """

    path: Path
    names: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]


def read_words(path: str | Path) -> WordTable:
    """Read a table whose first line has the columns' names; lines that begin with # are left out.

    Separated by commas, semicolons or tabs, whichever the header has most of, or else by blanks.
    Rows without any word are left out.

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
    given = [
        (number, line)
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip(" \t,;") and not line.lstrip().startswith("#")
    ]
    if len(given) < 2:
        raise FormatError("has no header and rows", path)
    most = max(",;\t", key=given[0][1].count)
    mark = most if most in given[0][1] else None
    lines = tuple(number for number, _ in given)
    header, *rows = (_words(line, mark, f"{path}, line {number}") for number, line in given)
    for number, row in zip(lines[1:], rows, strict=True):
        if len(row) != len(header):
            raise FormatError(
                f"has {len(row)} values for {len(header)} columns", f"{path}, line {number}"
            )
    return WordTable(Path(path), header, tuple(rows), lines[1:])


def _words(line: str, mark: str | None, place: str) -> tuple[str, ...]:
    if mark is None:
        return tuple(line.split())
    try:
        return tuple(word.strip() for word in next(csv.reader([line], delimiter=mark)))
    except csv.Error as error:
        raise FormatError(f"is no table ({error})", place) from error
