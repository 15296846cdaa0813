"""Point clouds in PLY and PCD files, text and binary: points, and their intensity if given."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lidar.formats.clouds.lzf import decompress
from lidar.formats.records.binary import check_whole, mapped_chunks
from lidar.formats.records.options import LidarOptions
from lidar.formats.records.rows import RowLayout, read_rows
from lidar.formats.records.screening import Agreement, Records, Screen
from lidar.scans import Scan
from spcola.arrays import FloatArray
from spcola.errors import FormatError
from spcola.formats.shapes.ply import PlyElement, parse_header

_HEAD_BYTES = 65536
_POINT = ("x", "y", "z")
_INTENSITIES = ("intensity", "scalar_intensity", "scalar_Intensity")
_PCD_WORDS = (b"VERSION", b"FIELDS")
_PCD_NEEDED = ("FIELDS", "SIZE", "TYPE", "POINTS", "DATA")
_PCD_KINDS = {"F": "f", "I": "i", "U": "u"}
_MOST_FIELDS = 10_000
# Most bytes that three bytes of LZF expand to.
_LARGEST_EXPANSION = 88
_UNUSED = Agreement(offset_m=0.0, tolerance_m=1.0)


@dataclass(frozen=True, eq=False)
class _CloudLayout:
    """Layout of the points of a cloud.

    Parameters
    ----------
    record : dtype
        Names and types of the fields of one point.
    count : int
        Points.
    begin : int
        Byte (binary) or line (text) at which they begin, from 0.
    data : {"ascii", "binary", "binary_compressed"}
    """

    record: np.dtype[Any]
    count: int
    begin: int
    data: str


def is_cloud(head: bytes) -> bool:
    """Return whether a file begins as a PLY or a PCD file does."""
    return head.startswith((b"ply\n", b"ply\r\n")) or _is_pcd(head)


def read_cloud(path: Path, options: LidarOptions) -> Iterator[Scan]:
    """Yield the points of a PLY or PCD cloud, metres unless `options` state another unit.

    Of a PLY mesh the vertices are used. Time, range and spacecraft are unknown.

    Raises
    ------
    FormatError
        If the header is broken, x, y, z are missing, or the file has fewer points than stated.
    """
    with path.open("rb") as stream:
        head = stream.read(_HEAD_BYTES)
    layout = _pcd_layout(head, path) if _is_pcd(head) else _ply_layout(head, path)
    names = layout.record.names or ()
    if not set(_POINT) <= set(names):
        raise FormatError(f"has no x, y, z among {', '.join(names)}", f"{path}, header")
    if layout.count == 0:
        raise FormatError("holds no points", path)
    screen = Screen(path, _UNUSED, options)
    unit = options.unit_m("m")
    for fields, unreadable in _CHUNKS[layout.data](path, layout, options.chunk):
        intensity = next((fields[name] for name in _INTENSITIES if name in fields), None)
        yield screen.scan(
            Records(
                points=unit * np.stack([fields[axis] for axis in _POINT], axis=1),
                intensity=intensity,
                unreadable=unreadable,
            )
        )


_Chunks = Iterator[tuple[dict[str, FloatArray], int]]


def _binary_chunks(path: Path, layout: _CloudLayout, chunk: int) -> _Chunks:
    check_whole(path, path.stat().st_size - layout.begin, layout.count, layout.record)
    for table in mapped_chunks(path, layout.record, layout.count, chunk, layout.begin):
        yield {name: table[name].astype(np.float64) for name in layout.record.names or ()}, 0


def _text_chunks(path: Path, layout: _CloudLayout, chunk: int) -> _Chunks:
    names = layout.record.names or ()
    rows = RowLayout(
        count=len(names), numbers=tuple(range(len(names))), skip=layout.begin, rows=layout.count
    )
    for part in read_rows(path, rows, chunk):
        yield dict(zip(names, part.numbers, strict=True)), part.unreadable


def _compressed_chunks(path: Path, layout: _CloudLayout, chunk: int) -> _Chunks:
    """Yield the points of a compressed PCD file, which stores field after field.

    It is one compressed block, so that all of it is in memory.
    """
    with path.open("rb") as stream:
        stream.seek(layout.begin)
        head, packed = stream.read(8), np.frombuffer(stream.read(), dtype=np.uint8)
    sizes = np.frombuffer(head.ljust(8, b"\0"), dtype="<u4")
    whole = layout.count * layout.record.itemsize
    unpacked = None
    possible = whole <= _LARGEST_EXPANSION * len(packed)
    if possible and sizes[1] == whole and len(packed) >= sizes[0]:
        unpacked = decompress(packed[: sizes[0]], whole)
    if unpacked is None:
        raise FormatError("has compressed points cut off or broken", path, "fetch it again")
    fields = {}
    begin = 0
    for name in layout.record.names or ():
        kind = layout.record[name]
        end = begin + layout.count * kind.itemsize
        fields[name] = unpacked[begin:end].view(kind).astype(np.float64)
        begin = end
    for start in range(0, layout.count, chunk):
        yield {name: values[start : start + chunk] for name, values in fields.items()}, 0


_CHUNKS = {
    "ascii": _text_chunks,
    "binary": _binary_chunks,
    "binary_compressed": _compressed_chunks,
}


def _ply_layout(head: bytes, path: Path) -> _CloudLayout:
    header = parse_header(head, path)
    order = ">" if header.encoding == "big" else "<"
    text = header.encoding == "ascii"
    begin = header.line_count if text else header.data_begin
    for element in header.elements:
        if element.name == "vertex":
            record = _ply_record(element, order, path)
            return _CloudLayout(record, element.count, begin, "ascii" if text else "binary")
        begin += element.count * (1 if text else _ply_record(element, order, path).itemsize)
    names = ", ".join(element.name for element in header.elements)
    raise FormatError(f"has no vertex among {names}", f"{path}, header")


def _ply_record(element: PlyElement, order: str, path: Path) -> np.dtype[Any]:
    """Return the binary record of an element whose properties are single numbers."""
    if any(entry.count_kind is not None for entry in element.properties):
        raise FormatError(
            f"has lists in its {element.name}", f"{path}, header", "save it as a plain cloud"
        )
    return np.dtype([(entry.name, order + entry.kind) for entry in element.properties])


def _is_pcd(head: bytes) -> bool:
    lines = [line for line in head.split(b"\n", 32)[:32] if not line.startswith(b"#")]
    return bool(lines) and lines[0].split(b" ")[0].strip() in _PCD_WORDS


def _pcd_layout(head: bytes, path: Path) -> _CloudLayout:
    """Parse the header of a PCD file: keywords in lines, DATA the last."""
    words: dict[str, list[str]] = {}
    begin = 0
    for number, line in enumerate(head.split(b"\n"), start=1):
        begin += len(line) + 1
        key, *values = line.decode("ascii", errors="replace").split() or ["#"]
        if not key.startswith("#"):
            words[key] = values
        if key == "DATA":
            return _pcd_checked(words, begin, number, path)
    raise FormatError("the header does not end", f"{path}, header", "the file is truncated")


def _pcd_checked(words: dict[str, list[str]], begin: int, lines: int, path: Path) -> _CloudLayout:
    place = f"{path}, header"
    lacking = [key for key in _PCD_NEEDED if not words.get(key)]
    if lacking:
        raise FormatError(f"has no {', '.join(lacking)}", place, "is it a PCD file?")
    data = words["DATA"][0]
    if data not in _CHUNKS:
        raise FormatError(f"has DATA {data}", place, f"save it as one of {', '.join(_CHUNKS)}")
    names = words["FIELDS"]
    repeats = words.get("COUNT", ["1"] * len(names))
    fields: list[tuple[str, str]] = []
    try:
        for name, size, kind, repeat in zip(
            names, words["SIZE"], words["TYPE"], repeats, strict=True
        ):
            if not 0 <= int(repeat) <= _MOST_FIELDS - len(fields):
                raise ValueError(f"{repeat} of {name}")
            for index in range(int(repeat)):
                label = f"{name}[{index}]" if int(repeat) > 1 else name
                # Padding fields are all called "_".
                label = f"{label}{len(fields)}" if name == "_" else label
                fields.append((label, f"<{_PCD_KINDS[kind]}{int(size)}"))
        record, count = np.dtype(fields), int(words["POINTS"][0])
    except (ValueError, KeyError, TypeError) as error:
        raise FormatError(f"fields, sizes, types and counts do not fit ({error})", place) from error
    if count < 0:
        raise FormatError(f"has {count} points", place)
    _check_extent(words, count, place)
    return _CloudLayout(record, count, lines if data == "ascii" else begin, data)


def _check_extent(words: dict[str, list[str]], count: int, place: str) -> None:
    """Refuse a width and height that do not make up the number of points."""
    try:
        extent = int(words["WIDTH"][0]) * int(words["HEIGHT"][0])
    except (KeyError, IndexError, ValueError) as error:
        raise FormatError("has no whole WIDTH and HEIGHT", place) from error
    if extent != count:
        raise FormatError(f"has {extent} points by WIDTH and HEIGHT, {count} by POINTS", place)
