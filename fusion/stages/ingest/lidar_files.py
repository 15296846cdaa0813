"""Lidar files of the scans of a workspace, from the scans and from the record of imports."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from fusion.pipeline.catalog import read_record
from fusion.workspace import Workspace
from lidar.formats.native import scan_summary
from lidar.scans import ScanSummary
from spcola.errors import FormatError, WorkspaceError

INGEST = "ingest"
"""Name of the import stage, and of its record."""


@dataclass(frozen=True)
class LidarFile:
    """A lidar file and how it is to be read.

    Parameters
    ----------
    path : Path
    name : str
        Name of the scan; if empty, the file's name without its suffix.
    format : str
        Empty: recognised by content.
    columns : mapping of str to str
        For a table: quantity → column with its unit.
    unit : str
        Unit of coordinates, if the format has none.
    gps_time : bool
        Keep the GPS time of LAS returns.
    """

    path: Path
    name: str = ""
    format: str = ""
    columns: Mapping[str, str] = field(default_factory=dict)
    unit: str = ""
    gps_time: bool = False

    @property
    def scan_name(self) -> str:
        """Name of its scan."""
        return self.name or self.path.name.removesuffix(".gz").rsplit(".", 1)[0] or self.path.name


def recorded_source(scan: ScanSummary) -> LidarFile | None:
    """Return the source of an imported scan; None for a scan that was not imported."""
    kept = dict(scan.parameters)
    if "source" not in kept:
        return None
    return _lidar_file(
        kept["source"], scan.name, {**kept, "columns": json.loads(str(kept["columns"]))}
    )


def _lidar_file(path: Any, name: str, reading: Mapping[str, Any]) -> LidarFile:
    """Rebuild a source from its recorded path and how it was read."""
    return LidarFile(
        Path(str(path)),
        name,
        str(reading["format"]),
        dict(reading["columns"]),
        str(reading["unit"]),
        bool(reading["gps_time"]),
    )


@dataclass(frozen=True)
class Origin:
    """Origin of a scan in the record of the import.

    Parameters
    ----------
    source : LidarFile
    digest : str
        SHA-256 of the source when it was read.
    returns : int
        Number of returns accepted.
    """

    source: LidarFile
    digest: str
    returns: int

    @classmethod
    def of(cls, scan: ScanSummary) -> Self | None:
        """Return the origin of a scan; None if it was not imported."""
        source = recorded_source(scan)
        return None if source is None else cls(source, scan.digest, scan.count)

    def as_json(self) -> dict[str, Any]:
        """Return the origin in JSON types."""
        source = self.source
        return {
            "file": str(source.path),
            "format": source.format,
            "columns": dict(source.columns),
            "unit": source.unit,
            "gps_time": source.gps_time,
            "digest": self.digest,
            "returns": self.returns,
        }

    @classmethod
    def from_json(cls, name: str, content: Mapping[str, Any]) -> Self:
        """Rebuild the origin of the scan `name` from the content of :meth:`as_json`."""
        source = _lidar_file(content["file"], name, content)
        return cls(source, str(content["digest"]), int(content["returns"]))


def recorded_origins(workspace: Workspace) -> dict[str, Origin]:
    """Return the origin of each scan, by its name, from the record of the last import."""
    record = read_record(workspace, INGEST)
    listed = {} if record is None else record.summary.get("sources") or {}
    return {name: Origin.from_json(name, content) for name, content in listed.items()}


def readable(path: Path) -> ScanSummary | None:
    """Return the summary of a scan; None if it is damaged."""
    try:
        return scan_summary(path)
    except FormatError:
        return None


def readable_scans(workspace: Workspace) -> dict[str, ScanSummary]:
    """Return the scans that are not damaged, by the names of their files."""
    found = {path.stem: readable(path) for path in workspace.scan_paths()}
    return {name: scan for name, scan in found.items() if scan is not None}


def duplicate_scans(scans: Mapping[str, ScanSummary]) -> list[tuple[str, str]]:
    """Return pairs of files, by their names, that hold the same scan."""
    found, names, digests = list[tuple[str, str]](), dict[str, str](), dict[str, str]()
    for name, scan in scans.items():
        other = names.setdefault(scan.name, name)
        if other == name and scan.digest:
            other = digests.setdefault(scan.digest, name)
        if other != name:
            found.append((other, name))
    return found


def check_duplicates(workspace: Workspace, scans: Mapping[str, ScanSummary]) -> None:
    """Refuse two files of the same scan.

    Raises
    ------
    WorkspaceError
        If two files hold the same scan; both are named.
    """
    for first, second in duplicate_scans(scans):
        raise WorkspaceError(
            f"holds the same scan as {workspace.scan_path(first)}",
            workspace.scan_path(second),
            "remove one of them",
        )
