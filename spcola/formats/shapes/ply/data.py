"""The data of a PLY file: each element's properties as arrays."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from spcola.arrays import AnyArray, IntArray
from spcola.errors import FormatError
from spcola.formats.shapes.ply.header import PlyElement, PlyHeader, PlyProperty
from spcola.formats.text.table import NumberRows, parse_rows

PlyValues = dict[str, AnyArray]
"""Values by property; a list is flattened, its counts are under ``NAME.count``."""


def read_elements(content: bytes, header: PlyHeader, path: str | Path) -> dict[str, PlyValues]:
    """Read all elements from the `content` of a PLY file with `header`; `path` is for messages.

    Raises
    ------
    FormatError
        If the data end early, go on after the last element, or a word is no number.
    """
    if header.encoding == "ascii":
        return _read_ascii(content, header, path)
    order = "<" if header.encoding == "little" else ">"
    begin = header.data_begin
    elements = {}
    for element in header.elements:
        elements[element.name], begin = _read_binary(content, begin, element, order, path)
    if begin != len(content):
        raise FormatError(
            f"has {len(content) - begin} bytes behind the last {header.elements[-1].name}", path
        )
    return elements


def _read_ascii(content: bytes, header: PlyHeader, path: str | Path) -> dict[str, PlyValues]:
    """Read the elements of an ascii file: one on each line."""
    text = content[header.data_begin :]
    count = text.count(b"\n") + (not text.endswith(b"\n"))
    lines = header.line_count + 1 + np.arange(count if text else 0)
    rest = parse_rows(text, path, lines=lines).without_blank_lines()
    wanted = sum(element.count for element in header.elements)
    if len(rest.counts) != wanted:
        raise FormatError(
            f"the header promises {wanted} elements, the file has {len(rest.counts)}",
            f"{path}, line {rest.lines[-1] if len(rest.lines) else header.line_count}",
            "it is truncated or mis-declared",
        )
    elements = {}
    for element in header.elements:
        rows, rest = rest.split(element.count)
        elements[element.name] = _ascii_values(rows, element)
    return elements


def _ascii_values(rows: NumberRows, element: PlyElement) -> PlyValues:
    """Return the properties of an element in `rows`."""
    ends = np.cumsum(rows.counts)
    at = ends - rows.counts
    values: PlyValues = {}
    for entry in element.properties:
        _check_within(rows, at, ends, element)
        if entry.count_kind is None:
            values[entry.name] = rows.values[at]
            at = at + 1
            continue
        counts = rows.values[at]
        none = (counts < 0) | (counts > len(rows.values)) | (counts != np.rint(counts))
        bad = np.flatnonzero(none)
        if len(bad):
            rows.fail(int(bad[0]), f"{entry.name}: {counts[bad[0]]:g} is no count")
        whole = counts.astype(np.int64)
        _check_within(rows, at + whole, ends, element)
        values[f"{entry.name}.count"] = whole
        values[entry.name] = rows.values[_spans(at + 1, whole)]
        at = at + 1 + whole
    if np.any(at != ends):
        rows.fail(int(np.flatnonzero(at != ends)[0]), f"has too many numbers for a {element.name}")
    return values


def _check_within(rows: NumberRows, at: IntArray, ends: IntArray, element: PlyElement) -> None:
    """Refuse rows that end before position `at`."""
    short = np.flatnonzero(at >= ends)
    if len(short):
        rows.fail(int(short[0]), f"has too few numbers for a {element.name}")


def _spans(begins: IntArray, counts: IntArray) -> IntArray:
    """Return begin, begin + 1, … of every span, one after the other."""
    shift = np.repeat(begins - (np.cumsum(counts) - counts), counts)
    return shift + np.arange(len(shift))


def _read_binary(
    content: bytes, begin: int, element: PlyElement, order: str, path: str | Path
) -> tuple[PlyValues, int]:
    """Return the properties of an element that begins at byte `begin`, and where it ends."""
    if all(entry.count_kind is None for entry in element.properties):
        kind = np.dtype([(entry.name, order + entry.kind) for entry in element.properties])
        end = begin + element.count * kind.itemsize
        _check_end(content, end, element, path)
        table = np.frombuffer(content, kind, count=element.count, offset=begin)
        return {entry.name: table[entry.name] for entry in element.properties}, end
    if not element.count:
        counted = [f"{entry.name}.count" for entry in element.properties if entry.count_kind]
        names = [*counted, *(entry.name for entry in element.properties)]
        return dict.fromkeys(names, np.zeros(0, dtype=np.int64)), begin
    return _read_alike(content, begin, element, order) or _read_unlike(
        content, begin, element, order, path
    )


def _read_alike(
    content: bytes, begin: int, element: PlyElement, order: str
) -> tuple[PlyValues, int] | None:
    """Read elements whose lists are all as long as the first one's; None if they are not."""
    fields: list[tuple[str, str, tuple[int, ...]]] = []
    at = begin
    for entry in element.properties:
        length = 1
        if entry.count_kind is not None:
            count = _number(content, at, order + entry.count_kind)
            if count is None:
                return None
            fields.append((f"{entry.name}.count", order + entry.count_kind, ()))
            at += np.dtype(entry.count_kind).itemsize
            length = count
            if length > len(content):
                return None
        fields.append((entry.name, order + entry.kind, (length,) if entry.count_kind else ()))
        at += length * np.dtype(entry.kind).itemsize
    kind = np.dtype(fields)
    end = begin + element.count * kind.itemsize
    if end > len(content):
        return None
    table = np.frombuffer(content, kind, count=element.count, offset=begin)
    for entry in element.properties:
        if entry.count_kind is not None and element.count:
            counts = table[f"{entry.name}.count"]
            if np.any(counts != counts[0]):
                return None
    return {name: table[name].ravel() for name, _, _ in fields}, end


def _read_unlike(
    content: bytes, begin: int, element: PlyElement, order: str, path: str | Path
) -> tuple[PlyValues, int]:
    """Read elements with lists of different lengths, one by one."""
    parts: dict[str, list[AnyArray]] = {entry.name: [] for entry in element.properties}
    counts: dict[str, list[int]] = {
        f"{entry.name}.count": [] for entry in element.properties if entry.count_kind
    }
    at = begin
    for _ in range(element.count):
        for entry in element.properties:
            length, at = _list_length(content, at, entry, order)
            end = at + length * np.dtype(entry.kind).itemsize
            _check_end(content, end, element, path)
            parts[entry.name].append(np.frombuffer(content[at:end], order + entry.kind))
            if entry.count_kind is not None:
                counts[f"{entry.name}.count"].append(length)
            at = end
    values: PlyValues = {name: np.concatenate(part) for name, part in parts.items()}
    return values | {name: np.array(count) for name, count in counts.items()}, at


def _list_length(content: bytes, at: int, entry: PlyProperty, order: str) -> tuple[int, int]:
    """Return how many numbers a property has at byte `at`, and where they begin."""
    if entry.count_kind is None:
        return 1, at
    count = _number(content, at, order + entry.count_kind)
    # A count that is cut off or negative requires more than any file has: the caller refuses it.
    return len(content) if count is None else count, at + np.dtype(entry.count_kind).itemsize


def _number(content: bytes, at: int, kind: str) -> int | None:
    """Return the count stored at byte `at`, or None if it is cut off or negative."""
    if at + np.dtype(kind).itemsize > len(content):
        return None
    value = int(np.frombuffer(content, kind, count=1, offset=at)[0])
    return value if value >= 0 else None


def _check_end(content: bytes, end: int, element: PlyElement, path: str | Path) -> None:
    """Refuse a file that ends before byte `end`."""
    if end > len(content):
        raise FormatError(
            f"ends at byte {len(content)}, before all {element.count} {element.name} elements",
            path,
            "it is truncated or mis-declared",
        )
