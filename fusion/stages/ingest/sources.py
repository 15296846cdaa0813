"""Where the scans of a workspace came from: by the scans themselves, and by their record."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from fusion.pipeline.catalog import read_record
from fusion.workspace import Workspace
from lidar.formats.native import scan_summary
from lidar.scans import ScanSummary
from spcola.errors import FormatError, WorkspaceError

INGEST = "ingest"
"""Name of the stage that keeps the scans, and of its record."""


@dataclass(frozen=True)
class Source:
    """A lidar file and how it is to be read.

    Parameters
    ----------
    path : Path
    name : str
        Of the scan; the file's name without its suffix if empty.
    format : str
        Empty: told from the content.
    columns : mapping of str to str
        Of a table: quantity → column with its unit.
    unit : str
        Of coordinates, where the format has none of its own.
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
        """Name of the scan that it becomes."""
        return self.name or self.path.name.removesuffix(".gz").rsplit(".", 1)[0] or self.path.name


def recorded_source(scan: ScanSummary) -> Source | None:
    """Return where an imported scan came from; None for a scan that was put here by hand."""
    kept = scan.parameters
    if "source" not in kept:
        return None
    return Source(
        Path(str(kept["source"])),
        scan.name,
        str(kept["format"]),
        json.loads(str(kept["columns"])),
        str(kept["unit"]),
        bool(kept["gps_time"]),
    )


@dataclass(frozen=True)
class Origin:
    """What the record of the import says of a scan.

    Parameters
    ----------
    source : Source
    digest : str
        SHA-256 of the source when it was read.
    returns : int
        How many were accepted.
    """

    source: Source
    digest: str
    returns: int

    @classmethod
    def of(cls, scan: ScanSummary) -> Self | None:
        """That of a scan; None if it was put here by hand."""
        source = recorded_source(scan)
        return None if source is None else cls(source, scan.digest, scan.count)

    def as_json(self) -> dict[str, Any]:
        """Return it in JSON types."""
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
        """Rebuild that of the scan `name` from what :meth:`as_json` gave."""
        source = Source(
            Path(content["file"]),
            name,
            str(content["format"]),
            dict(content["columns"]),
            str(content["unit"]),
            bool(content["gps_time"]),
        )
        return cls(source, str(content["digest"]), int(content["returns"]))


def recorded_origins(workspace: Workspace) -> dict[str, Origin]:
    """Return by name of the scan where each came from, by the record of the last import."""
    record = read_record(workspace, INGEST)
    listed = {} if record is None else record.summary.get("sources") or {}
    return {name: Origin.from_json(name, content) for name, content in listed.items()}


def readable(path: Path) -> ScanSummary | None:
    """Return the summary of a scan; None if it is damaged."""
    try:
        return scan_summary(path)
    except FormatError:
        return None


def whole_scans(workspace: Workspace) -> dict[str, ScanSummary]:
    """Return the scans that are not damaged, by the names of their files."""
    found = {path.stem: readable(path) for path in workspace.scan_paths()}
    return {name: scan for name, scan in found.items() if scan is not None}


def doubles(scans: Mapping[str, ScanSummary]) -> list[tuple[str, str]]:
    """Return pairs of scans, by the names of their files, that are one scan."""
    found, names, digests = list[tuple[str, str]](), dict[str, str](), dict[str, str]()
    for name, scan in scans.items():
        other = names.setdefault(scan.name, name)
        if other == name and scan.digest:
            other = digests.setdefault(scan.digest, name)
        if other != name:
            found.append((other, name))
    return found


def check_doubles(workspace: Workspace, scans: Iterable[tuple[str, ScanSummary]]) -> None:
    """Refuse to count a scan twice.

    Raises
    ------
    WorkspaceError
        If two files hold one scan; both are named.
    """
    for first, second in doubles(dict(scans)):
        raise WorkspaceError(
            f"holds the same scan as {workspace.scan_path(first)}",
            workspace.scan_path(second),
            "remove one of them",
        )
