"""Rows of text tables, read by chunks; a bad row is counted, a broken table is refused."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from lidar.formats.records.times import is_time
from spcola.arrays import AnyArray, BoolArray, FloatArray
from spcola.errors import FormatError

MOST_ROWS = 50_000
"""Rows read at once, whatever chunk is requested: as Python texts they are large."""


@dataclass(frozen=True)
class RowLayout:
    """Layout of the rows of a text table.

    Parameters
    ----------
    count : int
        Fields in a row.
    numbers, texts : tuple of int
        The fields (from 0) to read as numbers and as texts; others are ignored.
    separator : str, optional
        Between fields; blanks if not given.
    skip : int
        Header lines.
    rows : int, optional
        Number of rows, where other lines follow them; all lines if not given.
    fixed : bool
        All rows are equally long, so that a shorter last one has been cut off.
    split : callable, optional
        Splits a row instead of `separator`.
    """

    count: int
    numbers: tuple[int, ...]
    texts: tuple[int, ...] = ()
    separator: str | None = None
    skip: int = 0
    rows: int | None = None
    fixed: bool = False
    split: Callable[[str], list[str]] | None = None

    def fields(self, line: str) -> list[str]:
        """Return the fields of a row, stripped of blanks."""
        fields = self.split(line) if self.split else line.split(self.separator)
        return [field.strip() for field in fields]

    def is_timed_row(self, line: str) -> bool:
        """Return whether a line has all fields, and a UTC as the first text."""
        fields = self.fields(line)
        return len(fields) == self.count and is_time(fields[self.texts[0]])

    def parse(self, line: str) -> tuple[list[float], list[str]] | None:
        """Return the requested numbers and texts of a row, None if it has no such fields."""
        fields = self.fields(line)
        # Python would read "1_0" as ten.
        if len(fields) != self.count or "_" in line:
            return None
        try:
            return [float(fields[i]) for i in self.numbers], [fields[i] for i in self.texts]
        except ValueError:
            return None


@dataclass(frozen=True, eq=False)
class RowChunk:
    """Some rows, N of them readable.

    Parameters
    ----------
    numbers : (C, N) ndarray
        One row for each requested number.
    texts : list of list of str
        One list for each requested text.
    unreadable : int
        Rows that have too few or too many fields, or text where a number should be.
    """

    numbers: FloatArray
    texts: list[list[str]]
    unreadable: int


def read_rows(path: Path, layout: RowLayout, chunk: int) -> Iterator[RowChunk]:
    """Yield the rows of a text table in chunks; blank lines and lines after # are skipped.

    Raises
    ------
    FormatError
        If the table is empty, its last row is cut off, or most rows of a chunk are unreadable.
    """
    with path.open(encoding="ascii", errors="replace") as stream:
        for _ in range(layout.skip):
            if not stream.readline():
                break
        number = layout.skip
        previous = ""
        body = islice(stream, layout.rows)
        while lines := list(islice(body, min(chunk, MOST_ROWS))):
            _check_end(path, layout, lines, previous, number)
            yield _parse_sound(layout, lines) or _parse_singly(path, layout, lines, number)
            previous = lines[-1]
            number += len(lines)
    found = number - layout.skip
    if found == 0 or found < (layout.rows or 0):
        wanted = f"{found} of {layout.rows}" if layout.rows else "no"
        raise FormatError(f"is truncated: {wanted} rows are there", path, "fetch the file again")


def _check_end(path: Path, layout: RowLayout, lines: list[str], previous: str, before: int) -> None:
    """Refuse a last row that is cut off: without a line end, and incomplete."""
    last = lines[-1]
    if last.endswith("\n") or not last.strip():
        return
    whole = (lines[-2] if len(lines) > 1 else previous).rstrip("\n")
    short = layout.fixed and len(last.rstrip()) < len(whole.rstrip())
    if short or layout.parse(last) is None:
        raise FormatError(
            "is truncated: the last row is cut off",
            f"{path}, line {before + len(lines)}",
            "fetch the file again",
        )


def _parse_sound(layout: RowLayout, lines: list[str]) -> RowChunk | None:
    """Parse rows at once, ten times as fast; None if one of them is irregular."""
    if layout.split or any("_" in line or "#" in line or line.isspace() for line in lines):
        return None
    mark = layout.separator
    if mark is None and layout.numbers != tuple(range(layout.count)):
        return None
    if mark is not None and any(line.count(mark) != layout.count - 1 for line in lines):
        return None
    chosen = None if mark is None else layout.numbers
    try:
        table = np.loadtxt(lines, delimiter=mark, usecols=chosen, ndmin=2, comments=None)
    except ValueError:
        return None
    if table.shape != (len(lines), len(layout.numbers)):
        return None
    texts = [[line.split(mark, at + 1)[at].strip() for line in lines] for at in layout.texts]
    return RowChunk(np.ascontiguousarray(table.T), texts, 0)


def _parse_singly(path: Path, layout: RowLayout, lines: list[str], before: int) -> RowChunk:
    """Parse row by row, so that a bad one is found and the others are kept."""
    numbers: list[list[float]] = []
    texts: list[list[str]] = []
    bad: list[int] = []
    for index, line in enumerate(lines):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        parsed = layout.parse(line)
        if parsed is None:
            bad.append(index)
            continue
        numbers.append(parsed[0])
        texts.append(parsed[1])
    if len(bad) > len(numbers):
        raise FormatError(
            f"most rows are not {layout.count} fields with numbers where they belong, the first "
            f"such row is {lines[bad[0]].strip()[:60]!r}",
            f"{path}, line {before + bad[0] + 1}",
            "name the right format",
        )
    columns = [list(column) for column in zip(*texts, strict=True)] or [[] for _ in layout.texts]
    table = np.array(numbers, dtype=np.float64).reshape(len(numbers), len(layout.numbers))
    return RowChunk(np.ascontiguousarray(table.T), columns, len(bad))


def first_lines(head: bytes) -> list[str]:
    """Return the whole lines at the beginning of a file; none if it is not text."""
    if b"\0" in head:
        return []
    lines = head.decode("ascii", errors="replace").splitlines()
    # The last one may be incomplete: the head has a fixed length.
    return lines[:-1] if len(lines) > 1 and not head.endswith(b"\n") else lines


def mostly(lines: list[str], fits: Callable[[str], bool]) -> bool:
    """Return whether most of the non-blank `lines` fit: one bad row must not hide a table."""
    filled = [line for line in lines if line.strip()]
    return 2 * sum(map(fits, filled)) > len(filled)


def is_number(text: str) -> bool:
    """Return whether a text is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def flags_of(column: FloatArray) -> tuple[AnyArray, BoolArray]:
    """Return flags (N,) as whole numbers, and which of them are whole (the others become −1)."""
    known: BoolArray = (np.abs(column) < 2**53) & (column == np.rint(column))
    return np.where(known, column, -1).astype(np.int64), known
