"""Native scans: one HDF5 file a scan, chunked, checksummed, readable piece by piece."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import h5py
import numpy as np

from lidar.formats.options import LidarOptions
from lidar.scan import MEASURES, Scan
from spcola.atomic import replacing
from spcola.errors import FormatError, InvalidValueError

FORMAT = "SPCOLA scan"
VERSION = 1
MAGIC = b"\x89HDF\r\n\x1a\n"

_VECTORS = ("spacecraft", "beam", "points")
# Layers that carry the noise of the ranges shrink by a quarter at best, for most of the time of an
# import; what is constant or grows evenly shrinks to nearly nothing.
_NOISY = frozenset({"range", "beam", "points", "intensity"})
_COMPRESSED = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
BLOCK = 8192
"""Returns in a block: 64 or 192 kB of one layer, which a random reader can afford."""
NOISY_BYTES = 64
"""What the layers that are not compressed take of a return; the last block is whole on disk."""


@dataclass(frozen=True, eq=False)
class ScanSummary:
    """What a native scan file says about itself without its returns being read.

    Parameters
    ----------
    name, trajectory, body : str
        As in `Scan`.
    count : int
        Accepted returns.
    rejected : mapping of str to int
        Returns left out, by reason.
    time_span : (float, float)
        First and last ephemeris time, s; NaN if no time is known.
    bounds : (2, 3) ndarray
        Least and greatest x, y, z of the returns, metres; NaN if there is none.
    digest : str
        Digest of the source file, as given to `write_scan`.
    parameters : mapping of str to str, float or int
        Scan parameters that came with the source.
    """

    name: str
    count: int
    rejected: Mapping[str, int]
    time_span: tuple[float, float]
    trajectory: str
    body: str
    bounds: np.ndarray[Any, np.dtype[np.float64]]
    digest: str = ""
    parameters: Mapping[str, str | float | int] = field(default_factory=dict)


def is_native(head: bytes) -> bool:
    """Tell whether `head`, the first bytes of a file, begins an HDF5 file."""
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
    with replacing(path) as temporary, h5py.File(temporary, "w") as file:
        layers = _create_layers(file)
        summary: ScanSummary | None = None
        for scan in chunks:
            summary = _summary_of(scan) if summary is None else _extended(summary, scan, path)
            for name, layer in layers.items():
                layer.resize(summary.count, axis=0)
                layer[summary.count - len(scan) :] = getattr(scan, name)
        if summary is None:
            raise InvalidValueError("has no chunk to write", path)
        summary = replace(summary, digest=digest, parameters=dict(parameters or {}))
        _write_attributes(file, summary)
    return summary


def scan_summary(path: str | Path) -> ScanSummary:
    """Read the summary of a native scan.

    Raises
    ------
    FormatError
        If the file is no whole native scan.
    """
    with _Opened(path) as file:
        return _read_attributes(file)


def iter_scan(path: str | Path, *, chunk: int = 1_000_000) -> Iterator[Scan]:
    """Yield a native scan in chunks of at most `chunk` returns.

    The first chunk carries the rejection counts, so that joined chunks have them once. A scan
    without returns yields one empty chunk.

    Raises
    ------
    FormatError
        If the file is no whole native scan, or a block of it fails its checksum.
    """
    with _Opened(path) as file:
        summary = _read_attributes(file)
        for start in range(0, max(summary.count, 1), chunk):
            rows = slice(start, start + chunk)
            layers: dict[str, Any] = {name: file["returns"][name][rows] for name in MEASURES}
            yield Scan(
                name=summary.name,
                trajectory=summary.trajectory,
                body=summary.body,
                rejected=summary.rejected if start == 0 else {},
                **layers,
            )


def read_native(path: Path, options: LidarOptions) -> Iterator[Scan]:
    """Yield a native scan in chunks; it keeps its own frame and names.

    Raises
    ------
    FormatError
        As `iter_scan`.
    """
    for scan in iter_scan(path, chunk=options.chunk):
        yield scan if options.name is None else replace(scan, name=options.name)


class _Opened:
    """Opens a native scan, and turns what HDF5 says of broken files into one line."""

    def __init__(self, path: str | Path) -> None:
        self._path = Path(path)

    def __enter__(self) -> Any:
        try:
            self._file = h5py.File(self._path, "r")
        except OSError as error:
            raise self._broken(error) from error
        if self._file.attrs.get("format") != FORMAT:
            self._file.close()
            raise FormatError(
                "is an HDF5 file, but no native scan", self._path, "import its source instead"
            )
        return self._file

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        self._file.close()
        if isinstance(error, (OSError, KeyError, ValueError, InvalidValueError)):
            raise self._broken(error) from error

    def _broken(self, error: Exception) -> FormatError:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        return FormatError(
            f"is no whole native scan ({reason})", self._path, "import the source again"
        )


def _create_layers(file: Any) -> dict[str, Any]:
    """Create the growing data sets, one for each layer of a scan."""
    group = file.create_group("returns")
    layers = {}
    for name in MEASURES:
        width = (3,) if name in _VECTORS else ()
        layers[name] = group.create_dataset(
            name,
            shape=(0, *width),
            maxshape=(None, *width),
            chunks=(BLOCK, *width),
            dtype="<i8" if name == "flag" else "<f8",
            fletcher32=True,
            **({} if name in _NOISY else _COMPRESSED),
        )
    return layers


def _summary_of(scan: Scan) -> ScanSummary:
    known = scan.time[np.isfinite(scan.time)]
    span = (float(known.min()), float(known.max())) if len(known) else (math.nan, math.nan)
    bounds = np.full((2, 3), np.nan)
    if len(scan):
        bounds = np.stack([scan.points.min(axis=0), scan.points.max(axis=0)])
    return ScanSummary(
        name=scan.name,
        count=len(scan),
        rejected=scan.rejected,
        time_span=span,
        trajectory=scan.trajectory,
        body=scan.body,
        bounds=bounds,
    )


def _extended(summary: ScanSummary, scan: Scan, path: str | Path) -> ScanSummary:
    """Return `summary` with the next chunk added."""
    if (scan.trajectory, scan.body) != (summary.trajectory, summary.body):
        raise InvalidValueError("chunks lie in different frames", path)
    added = _summary_of(scan)
    rejected = dict(summary.rejected)
    for reason, count in scan.rejected.items():
        rejected[reason] = rejected.get(reason, 0) + count
    times = np.array([summary.time_span, added.time_span])
    return replace(
        summary,
        count=summary.count + added.count,
        rejected=rejected,
        # fmin and fmax pass over NaN, the span or bounds of a chunk that has none.
        time_span=(float(np.fmin(*times[:, 0])), float(np.fmax(*times[:, 1]))),
        bounds=np.stack(
            [
                np.fmin(summary.bounds[0], added.bounds[0]),
                np.fmax(summary.bounds[1], added.bounds[1]),
            ]
        ),
    )


def _write_attributes(file: Any, summary: ScanSummary) -> None:
    file.attrs.update(
        {
            "format": FORMAT,
            "version": VERSION,
            "name": summary.name,
            "count": summary.count,
            "trajectory": summary.trajectory,
            "body": summary.body,
            "time_span_et_s": summary.time_span,
            "bounds_m": summary.bounds,
            "source_digest": summary.digest,
            "rejected": json.dumps(dict(summary.rejected)),
            "parameters": json.dumps(dict(summary.parameters)),
        }
    )


def _read_attributes(file: Any) -> ScanSummary:
    attributes = file.attrs
    if attributes["version"] != VERSION:
        raise FormatError(
            f"has version {attributes['version']} of the native format, {VERSION} is known",
            file.filename,
            "import the source again",
        )
    first, last = attributes["time_span_et_s"]
    return ScanSummary(
        name=str(attributes["name"]),
        count=int(attributes["count"]),
        rejected=MappingProxyType(json.loads(attributes["rejected"])),
        time_span=(float(first), float(last)),
        trajectory=str(attributes["trajectory"]),
        body=str(attributes["body"]),
        bounds=np.asarray(attributes["bounds_m"], dtype=np.float64),
        digest=str(attributes["source_digest"]),
        parameters=MappingProxyType(json.loads(attributes["parameters"])),
    )
