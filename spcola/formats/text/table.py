"""Large tables of numbers in text: parsed at once, with the bad line in errors."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np

from spcola.arrays import AnyArray, FloatArray, IntArray
from spcola.errors import FormatError
from spcola.formats.text.fortran import LARGEST_NUMBER, parse_number

_NUMBER_BYTES = np.zeros(256, dtype=bool)
_NUMBER_BYTES[np.frombuffer(b"0123456789+-.eEdD", np.uint8)] = True
# Blanks of bytes.split; other control characters are part of a (wrong) word.
_BLANK_BYTES = np.zeros(256, dtype=bool)
_BLANK_BYTES[np.frombuffer(b" \t\n\r\v\f", np.uint8)] = True


@dataclass(frozen=True, eq=False)
class NumberRows:
    """The numbers of a text, and the line of each.

    Parameters
    ----------
    path : Path
        The file.
    values : (N,) ndarray
        All numbers, in their order.
    counts : (L,) ndarray of int
        How many of them are on each line.
    lines : (L,) ndarray of int
        Number of each line in the file, from 1.
    """

    path: Path
    values: FloatArray
    counts: IntArray
    lines: IntArray

    def without_blank_lines(self) -> NumberRows:
        """Return the same without lines that have no number."""
        kept = self.counts > 0
        return NumberRows(self.path, self.values, self.counts[kept], self.lines[kept])

    def split(self, count: int) -> tuple[NumberRows, NumberRows]:
        """Return the first `count` lines, and the others."""
        cut = int(self.counts[:count].sum())
        head = NumberRows(self.path, self.values[:cut], self.counts[:count], self.lines[:count])
        tail = NumberRows(self.path, self.values[cut:], self.counts[count:], self.lines[count:])
        return head, tail

    def table(self, widths: tuple[int, ...], what: str) -> FloatArray:
        """Return the numbers as a table (L, W); a FormatError unless W is the same, of `widths`."""
        width = int(self.counts[0]) if len(self.counts) else widths[0]
        if width not in widths:
            wanted = " or ".join(str(number) for number in widths)
            self.fail(0, f"{what} needs {wanted} numbers, not {width}")
        wrong = np.flatnonzero(self.counts != width)
        if len(wrong):
            self.fail(int(wrong[0]), f"{what} needs {width} numbers, not {self.counts[wrong[0]]}")
        return self.values.reshape(-1, width)

    def fail(self, row: int, what: str, do: str | None = None) -> NoReturn:
        """Raise a FormatError `what` about the line of `row`."""
        raise FormatError(what, f"{self.path}, line {self.lines[row]}", do)


def parse_rows(text: bytes, path: str | Path, *, lines: IntArray | None = None) -> NumberRows:
    """Parse a text of numbers (Fortran's D exponents too) separated by blanks and line ends.

    Parameters
    ----------
    text : bytes
        Some or all lines of the file, whole.
    path : str or Path
        For messages.
    lines : (L,) ndarray of int, optional
        Number in the file of each line of `text`; 1, 2, 3 … if not given.

    Raises
    ------
    FormatError
        With the line of the first word that is no finite number.
    """
    content = np.frombuffer(text, np.uint8)
    blank = _BLANK_BYTES[content]
    starts = np.flatnonzero(~blank & np.concatenate([[True], blank[:-1]]))
    ends = np.flatnonzero(content == ord("\n"))
    whole = len(ends) + (len(text) > 0 and not text.endswith(b"\n"))
    row = np.searchsorted(ends, starts)
    counts = np.bincount(row, minlength=whole)
    lines = np.arange(1, whole + 1) if lines is None else lines
    rows = NumberRows(Path(path), np.empty(0), counts, lines)
    odd = np.flatnonzero(~(blank | _NUMBER_BYTES[content]))
    values = None if len(odd) else _parse_fast(text, len(starts))
    if values is None:
        values = _parse_words(text, rows, row)
    return NumberRows(Path(path), values, counts, lines)


def _parse_fast(text: bytes, count: int) -> FloatArray | None:
    """Return the `count` numbers of `text`, or None if it is not a plain list of them."""
    plain = text.replace(b"D", b"E").replace(b"d", b"e")
    try:
        values: FloatArray = np.fromstring(plain, dtype=np.float64, sep=" ")
    except (ValueError, DeprecationWarning):  # the warning: NumPy before 2.3
        return None
    return values if len(values) == count and np.all(np.abs(values) <= LARGEST_NUMBER) else None


def _parse_words(text: bytes, rows: NumberRows, row: AnyArray) -> FloatArray:
    """Parse word by word: slow, but finds the bad one, and reads exponents without a letter."""
    values = np.empty(len(row))
    for index, word in enumerate(text.split()):
        try:
            values[index] = parse_number(word.decode("ascii", errors="replace"))
        except ValueError as error:
            rows.fail(int(row[index]), str(error))
    return values
