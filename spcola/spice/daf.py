"""The summaries of a DAF (SPK, CK, binary PCK): checked before SPICE follows them.

SPICE trusts addresses and counts of a binary kernel; damaged ones end the process.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import KernelError
from spcola.formats.text import read_bytes

RECORD = 1024
_WORDS = RECORD // 8
_ORDERS: dict[bytes, Literal["<", ">"]] = {b"LTL-IEEE": "<", b"BIG-IEEE": ">"}
# Doubles and integers in a summary, by file type.
_FORMS = {b"DAF/SPK ": (2, 6), b"DAF/CK  ": (2, 6), b"DAF/PCK ": (2, 5)}
_OLD = b"NAIF/DAF"
DISCRETE_TYPES = (9, 13)
"""Types of SPK segments with states at unequal steps."""
_LARGEST_DEGREE = 27
_AGAIN = "fetch the file again"


@dataclass(frozen=True, eq=False)
class DafSegment:
    """A segment of a DAF.

    Parameters
    ----------
    doubles, integers : tuple
        Its summary: of an SPK the span (ET, s), and target, centre, frame, type and addresses.
    values : (N,) ndarray
        Its elements.
    """

    doubles: tuple[float, ...]
    integers: tuple[int, ...]
    values: FloatArray


def is_daf(path: str | Path) -> bool:
    """Return whether a file begins as a binary DAF does."""
    return read_bytes(path, most=8).startswith((b"DAF/", _OLD))


def daf_segments(path: str | Path) -> list[DafSegment]:
    """Return the segments of a binary DAF, after checking that its summaries lie within the file.

    Raises
    ------
    KernelError
        If they do not, or the file is no DAF.
    """
    content = read_bytes(path)
    order = _ORDERS.get(content[88:96], "<")
    if len(content) < 3 * RECORD or content[:8] not in (*_FORMS, _OLD):
        raise KernelError("is no whole binary kernel (DAF)", path, _AGAIN)
    counts = struct.unpack_from(f"{order}2i", content, 8)
    if counts not in (_FORMS.get(content[:8], counts), (2, 6), (2, 5)):
        raise KernelError(f"has summaries of {counts} numbers", path, _AGAIN)
    words = np.frombuffer(content, f"{order}f8", count=len(content) // 8)
    segments: list[DafSegment] = []
    record, known = struct.unpack_from(f"{order}i", content, 76)[0], set[int]()
    while record:
        if not 2 <= record <= len(content) // RECORD or record in known:
            raise KernelError(f"has a wrong chain of summaries (record {record})", path, _AGAIN)
        known.add(record)
        after, _, number = words[(record - 1) * _WORDS :][:3]
        if not (0 <= number <= 25 and 0 <= after <= len(content) and after % 1 == 0):
            raise KernelError(f"has wrong summaries in record {record}", path, _AGAIN)
        for index in range(int(number)):
            begin = (record - 1) * RECORD + 24 + 40 * index
            segments.append(_segment(content, begin, counts, words, path))
        record = int(after)
    return segments


def check_daf(path: str | Path) -> None:
    """Raise a KernelError if SPICE could not safely follow summaries or states of a binary DAF."""
    spk = read_bytes(path, most=8) == b"DAF/SPK "
    for segment in daf_segments(path):
        if spk and segment.integers[3] in DISCRETE_TYPES:
            state_epochs(segment.values, path)


def state_epochs(values: FloatArray, path: str | Path) -> FloatArray:
    """Return the epochs (N,), ET s, of a segment of N discrete states (SPK types 9 and 13).

    Its elements are 6 N numbers of states, N epochs, each hundredth epoch but the last again, the
    degree (or window) of the interpolation, and N.

    Raises
    ------
    KernelError
        If they are not, or the epochs do not increase.
    """
    degree, number = values[-2:] if len(values) > 1 else (0.0, 0.0)
    finite = np.isfinite(number) and np.isfinite(degree)
    whole = finite and number % 1 == 0 and degree % 1 == 0 and 1 <= degree <= _LARGEST_DEGREE
    count = int(number) if whole and 0 < number < len(values) else 0
    if count == 0 or len(values) != 7 * count + (count - 1) // 100 + 2:
        raise KernelError(f"has {number:g} states in {len(values)} numbers", path, _AGAIN)
    epochs = np.array(values[6 * count : 7 * count], dtype=np.float64)
    if not (np.all(np.isfinite(values[: 6 * count])) and np.all(np.diff(epochs) > 0)):
        raise KernelError("has invalid states, or epochs that do not increase", path, _AGAIN)
    return epochs


def _segment(
    content: bytes, begin: int, counts: tuple[int, int], words: FloatArray, path: str | Path
) -> DafSegment:
    """Return the segment whose summary begins at a byte."""
    order = _ORDERS.get(content[88:96], "<")
    doubles = struct.unpack_from(f"{order}{counts[0]}d", content, begin)
    integers = struct.unpack_from(f"{order}{counts[1]}i", content, begin + 8 * counts[0])
    first, last = integers[-2:]
    if not (_WORDS < first <= last <= len(words)) or not np.all(np.isfinite(doubles)):
        raise KernelError(
            f"has a segment from word {first} to {last} of {len(words)}", path, _AGAIN
        )
    return DafSegment(doubles, integers, words[first - 1 : last])
