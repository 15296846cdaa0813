"""Files of the scans of a synthetic mission: OLA level 2, HDF5 or LAZ, and their sizes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from lidar.formats.clouds import write_las
from lidar.formats.missions import OLA_RECORD, write_ola
from lidar.formats.native import write_scan
from lidar.scans import Scan
from lidar.truth.settings import DEMODULATOR, MISSING, NO_RETURN, OVERFLOW, LidarSettings
from lidar.truth.track import NadirTrack
from spcola.errors import SettingsError

SCAN_FORMATS: Mapping[str, str] = MappingProxyType({"ola": ".dat", "hdf5": ".h5", "laz": ".laz"})
"""Formats of scans, and the endings of their files."""

_REASONS = {OVERFLOW: "overflow", NO_RETURN: "no return", MISSING: "missing"}
# Bytes of a file, and of each return in it, measured over rasters and tracks of several bodies,
# with an error of a tenth: noise does not compress, small differences between neighbours do.
_NATIVE_HEAD, _LAZ_HEAD = 15_000, 20_000
_NATIVE_BYTES = 20.2
_LAZ_BYTES, _LAZ_BYTES_AN_OCTAVE, _LAZ_SPACING = 7.2, 0.45, 0.07
_TRACK_LAZ_BYTES = 11.0


@dataclass(frozen=True)
class ScanSize:
    """Size of a scan.

    Attributes
    ----------
    shots : int
        Records of an OLA table.
    returns : int
        Expected number, where all shots meet ground that is not steep.
    bytes : int
        Expected size of the file, with an error of a tenth.
    """

    shots: int
    returns: int
    bytes: int


def scan_size(settings: LidarSettings, format: str, *, track: NadirTrack | None = None) -> ScanSize:
    """Return the size of a raster scan (or a `track`) with these settings in a format.

    Raises
    ------
    SettingsError
        If the format is none of :data:`SCAN_FORMATS`.
    """
    _check_format(format)
    shots = settings.shots if track is None else track.shots
    returns = round(shots * settings.expected_share)
    if format == "ola":
        return ScanSize(shots, returns, shots * OLA_RECORD.itemsize)
    if format == "hdf5":
        return ScanSize(shots, returns, _NATIVE_HEAD + round(returns * _NATIVE_BYTES))
    octaves = np.log2(settings.spacing / _LAZ_SPACING)
    each = max(1.0, _LAZ_BYTES + _LAZ_BYTES_AN_OCTAVE * float(octaves))
    each = each if track is None else _TRACK_LAZ_BYTES
    return ScanSize(shots, returns, _LAZ_HEAD + round(returns * each))


def write_scans(path: str | Path, chunks: Iterable[Scan], *, format: str) -> None:
    """Write the chunks of one scan, whole or not at all.

    An OLA table contains all shots, those without echo with their flags and sentinels, like real
    ones; the others contain returns only: HDF5 with the numbers of rejected shots, LAZ without.

    Parameters
    ----------
    path : path
    chunks : iterable of Scan
        From :func:`lidar.truth.scan.scan_chunks`; only one is in memory at a time.
    format : {"ola", "hdf5", "laz"}

    Raises
    ------
    SettingsError
        If the format is none of :data:`SCAN_FORMATS`.
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
    """Yield the valid returns of each of the `chunks`, the other shots counted by flag."""
    for scan in chunks:
        kind = scan.flag % DEMODULATOR
        counts = {reason: int((kind == value).sum()) for value, reason in _REASONS.items()}
        rejected = {reason: count for reason, count in counts.items() if count}
        yield replace(scan.select(kind == 0), rejected=rejected)


def _check_format(format: str) -> None:
    if format not in SCAN_FORMATS:
        raise SettingsError(
            f"{format!r} is none of {', '.join(SCAN_FORMATS)}", "format of the scans"
        )
