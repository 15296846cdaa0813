"""NAIF's DAF transfer text (.xsp, .xc, .xpc) and its binary form (.bsp, .bc, .bpc).

A transfer file contains a DAF (double precision array file) as text, so that it can be read on any
machine; SPICE reads the binary form only. CSPICE has no call that converts one, so this module
reads the text and writes the binary file, little-endian.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spcola.arrays import FloatArray
from spcola.atomic import write_bytes
from spcola.errors import FormatError
from spcola.formats.text import read_bytes, whole_number

SIGNATURE = "DAFETF NAIF DAF ENCODED TRANSFER FILE"
BEGIN_COMMENTS = "~NAIF/SPC BEGIN COMMENTS~"
END_COMMENTS = "~NAIF/SPC END COMMENTS~"

RECORD = 1024
WORDS = RECORD // 8
COMMENT_CHARACTERS = 1000
_DOUBLE = re.compile(r"-?[0-9A-F]{1,32}\^-?[0-9A-F]{1,3}", re.I)
_INTEGER = re.compile(r"-?[0-9A-F]{1,8}", re.I)
FTP_TEST = b"FTPSTR:\r:\n:\r\n:\r\x00:\x81:\x10\xce:ENDFTP"
"""Bytes at 700 of every DAF by which SPICE detects damage by a text-mode transfer."""


@dataclass(frozen=True)
class DafArray:
    """One array of a DAF: a segment of an SPK or CK.

    `doubles` and `integers` are its summary (without the two addresses), `values` its elements.
    """

    name: str
    doubles: tuple[float, ...]
    integers: tuple[int, ...]
    values: FloatArray


@dataclass(frozen=True)
class Daf:
    """A DAF: its identification word ("DAF/SPK "), internal name, arrays and comments."""

    word: str
    doubles: int
    integers: int
    internal_name: str
    arrays: tuple[DafArray, ...]
    comments: tuple[str, ...] = ()

    @property
    def summary_words(self) -> int:
        """Length of one summary in double-precision words (integers go two to a word)."""
        return self.doubles + (self.integers + 1) // 2


def is_transfer(path: str | Path) -> bool:
    """Return whether a file begins as a DAF transfer file does."""
    with Path(path).open("rb") as stream:
        return stream.read(len(SIGNATURE)) == SIGNATURE.encode()


def convert_transfer(source: str | Path, target: str | Path) -> None:
    """Write the binary form of a transfer file.

    Raises
    ------
    FormatError
        If `source` is not a whole transfer file; the message names the line.
    """
    write_bytes(Path(target), encode_daf(read_transfer(source)))


def read_transfer(path: str | Path) -> Daf:
    """Read the DAF transfer file at `path`.

    Raises
    ------
    FormatError
        If it is not a whole transfer file; the message names the line.
    """
    source = Path(path)
    lines = _Lines(source)
    if lines.next() != SIGNATURE:
        raise lines.error(f"does not begin with {SIGNATURE!r}")
    word, doubles, integers = lines.text(), lines.integer(), lines.integer()
    fits = 0 <= doubles <= 124 and 2 <= integers <= 250 and doubles + (integers + 1) // 2 <= 125
    if not (len(word) == 8 and fits):
        raise lines.error(f"{word!r}, {doubles}, {integers} is no DAF")
    name = lines.text()
    arrays: list[DafArray] = []
    for text in iter(lines.next, None):
        label, *rest = text.split() or [""]
        if label == "TOTAL_ARRAYS":
            if rest != [str(len(arrays))]:
                raise lines.error(f"{len(arrays)} arrays were read")
            return Daf(word, doubles, integers, name, tuple(arrays), tuple(_comments(lines)))
        if label != "BEGIN_ARRAY" or len(rest) != 2 or rest[0] != str(len(arrays) + 1):
            raise lines.error(f"BEGIN_ARRAY {len(arrays) + 1} was expected, not {text!r}")
        arrays.append(_read_array(lines, rest, doubles, integers))
    raise lines.error("ends before TOTAL_ARRAYS")


def encode_daf(daf: Daf) -> bytes:
    """Return the bytes of the binary file, little-endian ("LTL-IEEE")."""
    comments = _comment_records(daf.comments)
    per_record = (WORDS - 3) // daf.summary_words
    groups = [daf.arrays[i : i + per_record] for i in range(0, len(daf.arrays), per_record)] or [()]
    first = 2 + len(comments) // RECORD
    address = (first - 1 + 2 * len(groups)) * WORDS + 1
    directory = b""
    for index, group in enumerate(groups):
        record = first + 2 * index
        after = record + 2 if index + 1 < len(groups) else 0
        before = record - 2 if index else 0
        summaries = struct.pack("<3d", after, before, len(group))
        names = b""
        for array in group:
            end = address + len(array.values) - 1
            summaries += _summary(daf, array, address, end)
            names += array.name.ljust(8 * daf.summary_words).encode("ascii")
            address = end + 1
        directory += summaries.ljust(RECORD, b"\0") + names.ljust(RECORD, b" ")
    values = b"".join(array.values.astype("<f8").tobytes() for array in daf.arrays)
    data = values.ljust(-(-len(values) // RECORD) * RECORD, b"\0")
    last = first + 2 * (len(groups) - 1)
    return _file_record(daf, first, last, address) + comments + directory + data


def decode_double(text: str) -> float:
    """Return the number encoded as ``mantissa^exponent``: hexadecimal, 0.mantissa × 16^exp."""
    if not _DOUBLE.fullmatch(text):
        raise ValueError(f"{text!r} is no encoded number")
    mantissa, exponent = text.split("^")
    digits = mantissa.lstrip("-")
    return float(np.ldexp(float(int(mantissa, 16)), 4 * (int(exponent, 16) - len(digits))))


class _Lines:
    """The lines of a transfer file, with the number of the current one for messages."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.number = 0
        try:
            self._lines = iter(read_bytes(path).decode("ascii").splitlines())
        except UnicodeDecodeError as error:
            raise FormatError("is not text", path, "give a DAF transfer file") from error

    def next(self) -> str | None:
        """Return the next line, or None at the end."""
        self.number += 1
        return next(self._lines, None)

    def error(self, what: str) -> FormatError:
        """Return an error that names the current line."""
        return FormatError(what, f"{self.path}, line {self.number}", "fetch the file again")

    def text(self) -> str:
        """Return the next line without the quotes that must be around it."""
        line = self.next()
        if line is None or len(line) < 2 or (line[0], line[-1]) != ("'", "'"):
            raise self.error("a quoted value was expected")
        return line[1:-1]

    def integer(self) -> int:
        """Return the next quoted hexadecimal integer."""
        text = self.text()
        number = int(text, 16) if _INTEGER.fullmatch(text) else 2**31
        if not -(2**31) <= number < 2**31:
            raise self.error(f"{text!r} is not a hexadecimal integer of four bytes")
        return number

    def double(self) -> float:
        """Return the next quoted encoded double."""
        text = self.text()
        try:
            value = decode_double(text)
        except ValueError:
            value = math.inf
        if not math.isfinite(value):
            raise self.error(f"{text!r} is not an encoded number")
        return value

    def count(self, limit: int) -> int:
        """Return the next line as a decimal count of 1 … `limit`."""
        line = self.next()
        count = None if line is None else whole_number(line.strip())
        if count is None or not 1 <= count <= limit:
            raise self.error(f"a count of 1 to {limit} was expected")
        return count


def _read_array(lines: _Lines, label: list[str], doubles: int, integers: int) -> DafArray:
    """Read an array from after its BEGIN_ARRAY line to its END_ARRAY line."""
    total = whole_number(label[1])
    if total is None:
        raise lines.error(f"{label[1]!r} is not a count")
    name = lines.text()
    if len(name) > 8 * (doubles + (integers + 1) // 2):
        raise lines.error(f"{name!r} is too long for the name of an array")
    bounds = tuple(lines.double() for _ in range(doubles))
    codes = tuple(lines.integer() for _ in range(integers - 2))
    values: list[float] = []
    while len(values) < total:
        values.extend(lines.double() for _ in range(lines.count(total - len(values))))
    if (lines.next() or "").split() != ["END_ARRAY", *label]:
        raise lines.error(f"END_ARRAY {' '.join(label)} was expected")
    return DafArray(name, bounds, codes, np.array(values))


def _comments(lines: _Lines) -> Iterator[str]:
    """Yield the lines of the comment area after the arrays."""
    inside = False
    for line in iter(lines.next, None):
        if line.strip() == END_COMMENTS:
            return
        if inside:
            yield line
        inside = inside or line.strip() == BEGIN_COMMENTS
    if inside:
        raise lines.error("ends within its comments")


def _comment_records(comments: tuple[str, ...]) -> bytes:
    """Return the comment area: 1000 characters a record, NUL between lines, EOT at the end."""
    if not comments:
        return b""
    text = "".join(f"{line}\0" for line in comments).encode("ascii") + b"\x04"
    parts = [text[i : i + COMMENT_CHARACTERS] for i in range(0, len(text), COMMENT_CHARACTERS)]
    return b"".join(part.ljust(RECORD, b"\0") for part in parts)


def _summary(daf: Daf, array: DafArray, begin: int, end: int) -> bytes:
    """Return the summary of an array that lies at words `begin` … `end` (from 1)."""
    integers = (*array.integers, begin, end)
    packed = struct.pack(f"<{len(array.doubles)}d", *array.doubles)
    packed += struct.pack(f"<{len(integers)}i", *integers)
    return packed.ljust(8 * daf.summary_words, b"\0")


def _file_record(daf: Daf, first: int, last: int, free: int) -> bytes:
    """Return the file record: identification, first and last summary record, first free word."""
    head = struct.pack(
        "<8s2i60s3i8s",
        daf.word.encode("ascii"),
        daf.doubles,
        daf.integers,
        daf.internal_name.ljust(60)[:60].encode("ascii"),
        first,
        last,
        free,
        b"LTL-IEEE",
    )
    return (head.ljust(699, b"\0") + FTP_TEST).ljust(RECORD, b"\0")
