"""Scans of a synthetic mission in files: OLA level 2, HDF5 or LAZ, and how large they will be."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

from lidar.formats.las_writer import write_las
from lidar.formats.native import write_scan
from lidar.formats.ola import RECORD, write_ola
from lidar.scan import Scan
from lidar.truth.settings import DEMODULATOR, MISSING, NO_RETURN, OVERFLOW, LidarSettings
from lidar.truth.track import Track
from spcola.errors import SettingsError

FORMATS: Mapping[str, str] = MappingProxyType({"ola": ".dat", "hdf5": ".h5", "laz": ".laz"})
"""Formats that scans can be written in, and the endings of their files."""

_REASONS = {OVERFLOW: "overflow", NO_RETURN: "no return", MISSING: "missing"}
# Of one return in a raster of 7 cm from 750 m, as measured; noise does not compress, so that other
# scans differ by a few per cent.
_NATIVE_BYTES, _LAZ_BYTES = 72.0, 14.0
# What a file holds however few its returns are.
_NATIVE_HEAD, _LAZ_HEAD = 30_000, 1_500


@dataclass(frozen=True)
class ScanSize:
    """What a scan comes to.

    Attributes
    ----------
    shots : int
        As many records an OLA table has.
    returns : int
        Expected, where all shots meet ground that is not steep.
    bytes : int
        Of the file, expected.
    """

    shots: int
    returns: int
    bytes: int


def scan_size(settings: LidarSettings, format: str, *, track: Track | None = None) -> ScanSize:
    """Return what a raster scan (or a `track`) of these settings comes to in a format.

    Raises
    ------
    SettingsError
        If the format is none of :data:`FORMATS`.
    """
    _check_format(format)
    shots = settings.shots if track is None else track.shots
    returns = round(shots * settings.expected_share)
    size = {
        "ola": shots * RECORD.itemsize,
        "hdf5": _NATIVE_HEAD + round(returns * _NATIVE_BYTES),
        "laz": _LAZ_HEAD + round(returns * _LAZ_BYTES),
    }
    return ScanSize(shots, returns, size[format])


def write_scans(path: str | Path, chunks: Iterable[Scan], *, format: str) -> None:
    """Write the chunks of one scan, whole or not at all.

    An OLA table holds all shots, those without echo with their flags and sentinels, as real ones
    do; the others hold returns only: HDF5 with the numbers of those left out, LAZ without.

    Parameters
    ----------
    path : path
    chunks : iterable of Scan
        As :func:`lidar.truth.scan.scan_chunks` yields them; only one is in memory at a time.
    format : {"ola", "hdf5", "laz"}

    Raises
    ------
    SettingsError
        If the format is none of :data:`FORMATS`.
    InvalidValueError
        If there is no chunk, or for LAZ no return.
    WorkspaceError
        If the file cannot be written.
    """
    _check_format(format)
    if format == "ola":
        write_ola(path, chunks)
    elif format == "hdf5":
        write_scan(path, returns_of(chunks))
    else:
        write_las(path, returns_of(chunks))


def returns_of(chunks: Iterable[Scan]) -> Iterator[Scan]:
    """Yield the valid returns of each chunk, the other shots counted by what their flag says."""
    for scan in chunks:
        kind = scan.flag % DEMODULATOR
        counts = {reason: int((kind == value).sum()) for value, reason in _REASONS.items()}
        rejected = {reason: count for reason, count in counts.items() if count}
        yield replace(scan.select(kind == 0), rejected=rejected)


def _check_format(format: str) -> None:
    if format not in FORMATS:
        raise SettingsError(f"{format!r} is none of {', '.join(FORMATS)}", "format of the scans")
