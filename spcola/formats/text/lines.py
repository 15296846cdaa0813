"""Text files with a fixed sequence of lines: a cursor that names the wrong line in errors."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import FormatError
from spcola.formats.text.fortran import is_number, parse_number
from spcola.formats.text.source import read_text_bytes


class LineCursor:
    """The lines of a text file, one after the other.

    Parameters
    ----------
    path : str or Path
        The file; opened once, closed again.

    Raises
    ------
    FormatError
        If it cannot be read, is empty, or is not text; from the methods, with the number of the
        line, if the file has ended or a line is not as wanted.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        content = read_text_bytes(path)
        try:
            text = content.decode("ascii")
        except UnicodeDecodeError as error:
            line = content[: error.start].count(b"\n") + 1
            raise FormatError(
                f"holds byte {content[error.start]:#04x}, which is not text", f"{path}, line {line}"
            ) from error
        self.lines = [line.rstrip() for line in text.splitlines()]
        self.number = 0

    @property
    def place(self) -> str:
        """The file and the number of the line that was read last."""
        return f"{self.path}, line {self.number}"

    def error(self, what: str, do: str | None = None) -> FormatError:
        """Return an error about the line that was read last."""
        return FormatError(what, self.place, do)

    def next(self, wanted: str) -> str:
        """Return the next line without its end; `wanted` is its description for errors."""
        self.number += 1
        if self.number > len(self.lines):
            raise self.error(f"the file ends where {wanted} should be", "it is truncated")
        return self.lines[self.number - 1]

    def fields(self, line: str, counts: Sequence[int], labels: Sequence[str]) -> FloatArray:
        """Return the numbers at the start of a labelled `line`, the one that was read last.

        There must be one of `counts` of them, and one of `labels` (the usual one first) after them.
        """
        wanted = [label.split() for label in labels]
        tokens = line.split()
        ends = [len(tokens) - len(label) for label in wanted if tokens[-len(label) :] == label]
        if not ends:
            numbers = next((n for n, token in enumerate(tokens) if not is_number(token)), None)
            found = "no label" if numbers is None else repr(" ".join(tokens[numbers:]))
            raise self.error(f"expected the line {labels[0]}, found {found}")
        values = self.numbers(tokens[: ends[0]], labels[0])
        if len(values) not in counts:
            wanted_count = " or ".join(str(count) for count in counts)
            raise self.error(f"{labels[0]} needs {wanted_count} numbers, not {len(values)}")
        return values

    def next_fields(self, count: int, *labels: str) -> FloatArray:
        """Return the `count` numbers of the next line, which must have one of `labels`."""
        return self.fields(self.next(f"the line {labels[0]}"), (count,), labels)

    def next_integers(self, count: int, *labels: str) -> list[int]:
        """Return the `count` whole numbers of the next line, which must have one of `labels`."""
        values = self.next_fields(count, *labels)
        if np.any(values != np.rint(values)):
            raise self.error(f"{labels[0]} needs whole numbers")
        return [int(value) for value in values]

    def next_sigma(self, *labels: str) -> FloatArray:
        """Return the next line's three sigmas (3,) (one is repeated); negative is unknown, NaN."""
        values = self.fields(self.next(f"the line {labels[0]}"), (1, 3), labels)
        known = np.where(values < 0, np.nan, values)
        return np.broadcast_to(known, 3).copy()

    def next_unit_vector(self, *labels: str) -> FloatArray:
        """Return the next line's unit vector (3,): its length must be 1 within 1e-5."""
        vector = self.next_fields(3, *labels)
        length = float(np.linalg.norm(vector))
        if abs(length - 1.0) > 1e-5:
            raise self.error(f"{labels[0]} has length {length:.7g}: it is no unit vector")
        return vector

    def numbers(self, tokens: Sequence[str], name: str) -> FloatArray:
        """Return `tokens` of the current line as numbers, all of which must be finite."""
        try:
            return np.array([parse_number(token) for token in tokens], dtype=np.float64)
        except ValueError as error:
            raise self.error(f"{name}: {error}") from error
