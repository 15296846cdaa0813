"""Native scans: one HDF5 file a scan, its blocks sorted by place, checksummed, read by mapping."""

from __future__ import annotations

import json
import math
import mmap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType, UnionType
from typing import Any
from zlib import crc32

import numpy as np

from lidar.formats.native.blocks import LAYERS, Block, decode, encode, spacecraft_knots
from lidar.formats.records.options import LidarOptions
from lidar.scans import Scan, ScanSummary
from lidar.scans.cubes import MOST_BITS
from spcola.arrays import AnyArray
from spcola.errors import FormatError, InvalidValueError
from spcola.formats.hdf5 import (
    read_number,
    read_text,
    reading_hdf5,
    replacing_hdf5,
    sealed,
    stored,
)
from spcola.formats.text import LARGEST_NUMBER
from spcola.navigation import Trajectory

FORMAT = "SPCOLA scan"
VERSION = 3
# Scans of version 2 have no checksum of their attributes; they are read as they are.
_UNSEALED = 2
MAGIC = b"\x89HDF\r\n\x1a\n"

_BLOCK = "block{:05d}"


def is_native(head: bytes) -> bool:
    """Return whether `head`, the first bytes of a file, begins an HDF5 file."""
    return head.startswith(MAGIC)


def write_scan(
    path: str | Path,
    chunks: Iterable[Scan],
    *,
    digest: str = "",
    parameters: Mapping[str, str | float | int] | None = None,
) -> ScanSummary:
    """Write the chunks of one scan to `path`, whole or not at all; return its summary.

    Only one chunk is in memory at a time. Rejection counts of the chunks add up.

    Parameters
    ----------
    digest : str
        Digest of the file that the scan came from.
    parameters : mapping
        Scan parameters to keep (strings and numbers).

    Raises
    ------
    InvalidValueError
        If there is no chunk, or the chunks lie in different frames.
    WorkspaceError
        If the file cannot be written.
    """
    with replacing_hdf5(path, seal=True) as file:
        summary: ScanSummary | None = None
        blocks = 0
        for scan in chunks:
            summary = ScanSummary.of(scan) if summary is None else summary.extended(scan, path)
            if len(scan):
                _write_block(file.create_group(_BLOCK.format(blocks)), encode(scan))
                blocks += 1
        if summary is None:
            raise InvalidValueError("has no chunk to write", path)
        summary = replace(summary, digest=digest, parameters=dict(parameters or {}))
        _write_attributes(file, summary, blocks)
    return summary


def scan_summary(path: str | Path) -> ScanSummary:
    """Read the summary of the native scan at `path`.

    Raises
    ------
    FormatError
        If the file is no whole native scan.
    """
    with _opened(path) as file:
        return _read_attributes(file)


class ScanFile:
    """The native scan at `path`, mapped into memory; usable from several threads.

    Attributes
    ----------
    summary : ScanSummary
    blocks : sequence of Block
        Their layers are views of the file. A layer is compared with its checksum at its first
        use.

    Raises
    ------
    FormatError
        If the file is no whole native scan; for a layer that fails its checksum, from the first
        use of it.
    """

    def __init__(self, path: str | Path) -> None:
        with _opened(path) as file:
            self.summary = _read_attributes(file)
            count = int(read_number(file, "blocks"))
            if count != len(file):
                raise InvalidValueError(f"states {count}, {len(file)} are there", "blocks")
            groups = [file[_BLOCK.format(k)] for k in range(count)]
            present = sum(int(group["place"].shape[0]) for group in groups)
            if present != self.summary.count:
                raise InvalidValueError(
                    f"{present} of {self.summary.count} returns are there", "place"
                )
            # Mapped within the context, so that the error for a file that is too short names it.
            with Path(path).open("rb") as raw:
                self._map = mmap.mmap(raw.fileno(), 0, access=mmap.ACCESS_READ)
            content = np.frombuffer(self._map, dtype=np.uint8)
            self.blocks: Sequence[Block] = [
                _read_block(Path(path), content, group) for group in groups
            ]

    def release(self) -> None:
        """Release the memory of layers that were read; they are mapped again when needed."""
        if hasattr(self._map, "madvise"):  # not on Windows
            self._map.madvise(mmap.MADV_DONTNEED)

    def trajectory(self) -> Trajectory:
        """Return the positions of the spacecraft over the span of the scan.

        Raises
        ------
        InvalidValueError
            If no return has both a time and a position of the spacecraft.
        """
        knots = [spacecraft_knots(block) for block in self.blocks]
        time = np.concatenate([np.empty(0), *(times for times, _ in knots)])
        if not len(time):
            raise InvalidValueError(
                "has no time with a spacecraft position", self.summary.name, "it cannot be moved"
            )
        time, first = np.unique(time, return_index=True)
        position = np.concatenate([positions for _, positions in knots])[first]
        return Trajectory(self.summary.trajectory, time, position)

    def chunks(self, most: int) -> Iterator[Scan]:
        """Yield the returns as scans of at most `most`; see :func:`iter_scan`."""
        name, body, trajectory = self.summary.name, self.summary.body, self.summary.trajectory
        rejected = self.summary.rejected
        if not self.blocks:
            none = Scan.of_points(name, np.empty((0, 3)), body=body, trajectory=trajectory)
            yield replace(none, rejected=rejected)
        for block in self.blocks:
            count = len(block.layers["place"])
            for begin in range(0, count, most):
                part = block.part(begin, min(begin + most, count))
                scan = decode(part, name, trajectory=trajectory, body=body)
                yield replace(scan, rejected=rejected)
                rejected = MappingProxyType({})


def iter_scan(path: str | Path, *, chunk: int = 1_000_000) -> Iterator[Scan]:
    """Yield the native scan at `path` in chunks of at most `chunk` returns.

    Returns come block by block, sorted by place, not by time. The first chunk carries the
    rejection counts, so that joined chunks have them once. A scan without returns yields one
    empty chunk.

    Raises
    ------
    FormatError
        If the file is no whole native scan, or a layer of it fails its checksum.
    """
    yield from ScanFile(path).chunks(chunk)


def read_native(path: Path, options: LidarOptions) -> Iterator[Scan]:
    """Yield a native scan in chunks; it keeps its own frame and names.

    Raises
    ------
    FormatError
        As `iter_scan`.
    """
    for scan in iter_scan(path, chunk=options.chunk):
        yield scan if options.name is None else replace(scan, name=options.name)


def _opened(path: str | Path) -> AbstractContextManager[Any]:
    """Open a native scan; HDF5's errors for broken files become one line."""
    return reading_hdf5(path, FORMAT, "is no whole native scan", "import the source again")


@dataclass(frozen=True)
class _Place:
    """Offset of a layer in its file, its type and shape, and its checksum."""

    offset: int
    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    checksum: int

    @property
    def size(self) -> int:
        """Bytes."""
        return self.dtype.itemsize * math.prod(self.shape)


def _place(data: Any) -> _Place:
    offset = data.id.get_offset()
    if offset is None:
        raise InvalidValueError("is packed or has no data, so that it cannot be mapped", data.name)
    return _Place(int(offset), data.dtype, data.shape, int(data.attrs["crc32"]))


class _Layers(Mapping[str, AnyArray]):
    """Layers of a block as views of the mapped file."""

    def __init__(
        self, path: Path, content: np.ndarray[Any, Any], places: Mapping[str, _Place]
    ) -> None:
        self._path, self._content, self._places = path, content, places
        self._sound: dict[str, AnyArray] = {}
        for name, place in places.items():
            if place.offset + place.size > len(content):
                raise InvalidValueError("is cut off", name)

    def __getitem__(self, name: str) -> AnyArray:
        if name not in self._sound:
            place = self._places[name]
            raw = self._content[place.offset : place.offset + place.size]
            if crc32(raw.data) != place.checksum:
                raise FormatError(
                    f"is no whole native scan ({name} fails its checksum)",
                    self._path,
                    "import the source again",
                )
            self._sound[name] = raw.view(place.dtype).reshape(place.shape)
        return self._sound[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


def _read_block(path: Path, content: np.ndarray[Any, Any], group: Any) -> Block:
    """Return a block whose layers are views; refuse one that lacks a layer, or part of one."""
    numbers = {name: read_number(group, name) for name in group.attrs if name != "layers"}
    limits = {"bits": MOST_BITS, "flag": 2**31}
    for name, number in numbers.items():
        whole = name not in limits or number % 1 == 0
        if not (whole and abs(number) <= limits.get(name, LARGEST_NUMBER)):
            raise InvalidValueError(f"is {number:g}", name)
    if numbers["bits"] < 0:
        raise InvalidValueError("is negative", "bits")
    places = {name: _place(data) for name, data in group.items()}
    if sorted(places) != json.loads(read_text(group, "layers")):
        raise InvalidValueError("layers are missing", group.name)
    _check_layers(places)
    return Block(_Layers(path, content, places), numbers)


def _check_layers(places: Mapping[str, _Place]) -> None:
    """Refuse layers of another type or shape than written; kernels rely on both."""
    cubes, knots = places["cube"].shape[0], places.get("flight_time")
    rows = {
        "returns": places["place"].shape[0],
        "cubes": cubes,
        "starts": cubes + 1,
        "knots": 0 if knots is None else knots.shape[0],
    }
    for name, place in places.items():
        kind, of, row = LAYERS[name]
        if place.dtype != np.dtype(kind) or place.shape != (rows[of], *row):
            raise InvalidValueError(f"is of type {place.dtype} and shape {place.shape}", name)


def _write_block(group: Any, block: Block) -> None:
    group.attrs.update(block.numbers)
    group.attrs["layers"] = stored(json.dumps(sorted(block.layers)))
    for name, layer in block.layers.items():
        # Contiguous, so that it can be mapped.
        values = np.ascontiguousarray(layer, dtype=layer.dtype.newbyteorder("<"))
        group.create_dataset(name, data=values).attrs["crc32"] = crc32(values.data)


def _write_attributes(file: Any, summary: ScanSummary, blocks: int) -> None:
    file.attrs.update(
        {
            "format": stored(FORMAT),
            "version": VERSION,
            "name": stored(summary.name),
            "count": summary.count,
            "blocks": blocks,
            "trajectory": stored(summary.trajectory),
            "body": stored(summary.body),
            "time_span_et_s": summary.time_span,
            "bounds_m": summary.bounds,
            "source_digest": stored(summary.digest),
            "rejected": stored(json.dumps(dict(summary.rejected))),
            "parameters": stored(json.dumps(dict(summary.parameters))),
        }
    )


def _read_attributes(file: Any) -> ScanSummary:
    attributes = file.attrs
    version = read_number(file, "version")
    if version not in (VERSION, _UNSEALED):
        raise FormatError(
            f"has version {version} of the native format, {VERSION} is known",
            file.filename,
            "import the source again",
        )
    if not (version == _UNSEALED if (intact := sealed(file)) is None else intact):
        raise InvalidValueError("fail their checksum", "attributes")
    first, last = attributes["time_span_et_s"]
    return ScanSummary(
        name=read_text(file, "name"),
        count=int(read_number(file, "count")),
        rejected=MappingProxyType(_mapping(file, "rejected", int)),
        time_span=(float(first), float(last)),
        trajectory=read_text(file, "trajectory"),
        body=read_text(file, "body"),
        bounds=np.asarray(attributes["bounds_m"], dtype=np.float64).reshape(2, 3),
        digest=read_text(file, "source_digest"),
        parameters=MappingProxyType(_mapping(file, "parameters", str | int | float)),
    )


def _mapping(file: Any, name: str, kind: type | UnionType) -> dict[str, Any]:
    """Return an attribute that contains a mapping to values of a type, as JSON text."""
    content = json.loads(read_text(file, name))
    if not isinstance(content, dict) or not all(isinstance(v, kind) for v in content.values()):
        raise InvalidValueError("has unexpected content", name)
    return content
