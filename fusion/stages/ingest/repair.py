"""Scans that have to be read again from their files, which may have changed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from fusion.estimation.verdict import Code, Severity, Verdict
from fusion.pipeline import StageContext
from fusion.stages.ingest.lidar_files import (
    INGEST,
    LidarFile,
    Origin,
    readable,
    recorded_origins,
    recorded_source,
)
from lidar.formats.native import scan_summary
from lidar.scans import ScanSummary
from spcola.errors import WorkspaceError


@dataclass(frozen=True)
class Due:
    """A scan that has to be read again.

    Parameters
    ----------
    source : LidarFile
    digest : str
        Present SHA-256 of the source.
    why : str
        The reason for a message; empty if the settings have changed.
    least : int
        Fewest returns without a loss; 0 if any number will do.
    """

    source: LidarFile
    digest: str
    why: str = ""
    least: int = 0


@dataclass(frozen=True, eq=False)
class Repair:
    """The scans of a workspace, and which of them have to be read again.

    Parameters
    ----------
    context : StageContext
        Context of the import stage.
    scans : mapping of Path to ScanSummary
        Readable scans.
    damaged : mapping of Path to Origin
        Scans that cannot be read or have changed since the stage ran, with their origins.
    """

    context: StageContext
    scans: Mapping[Path, ScanSummary]
    damaged: Mapping[Path, Origin]

    @property
    def verdict(self) -> Verdict:
        """A note on changed scans that were accepted as they are."""
        own = self.context.own
        accepted = Code.CHANGED_INPUT in self.context.settings.accept.codes
        return Verdict((own.finding(Severity.NOTE),) if own and accepted else ())

    @classmethod
    def of(cls, context: StageContext) -> Self:
        """Check all scans.

        Raises
        ------
        WorkspaceError, FormatError
            If one is gone, or is damaged and cannot be read again from an unchanged file,
            unless changed inputs are accepted.
        """
        workspace, own = context.workspace, context.own
        accepted = Code.CHANGED_INPUT in context.settings.accept.codes
        if own is not None and own.gone and not accepted:
            raise WorkspaceError(
                own.text,
                workspace.root / "scans",
                "import their files again, or continue without them: spcola run "
                f"{workspace.root} --accept {Code.CHANGED_INPUT}",
            )
        known, scans, damaged = recorded_origins(workspace), {}, {}
        differing = () if own is None else own.differing
        for path in workspace.scan_paths():
            scan, changed = readable(path), workspace.relative(path) in differing
            if scan is not None and (accepted or not changed):
                scans[path] = scan
            else:
                damaged[path] = _unchanged_origin(context, path, known.get(path.stem))
        return cls(context, scans, damaged)

    def due(self, key: Callable[[LidarFile], str]) -> dict[Path, Due]:
        """Return the scans that have to be read again; `key` digests how a source is read now.

        Raises
        ------
        WorkspaceError
            If the file of one is gone.
        """
        due = {
            path: Due(origin.source, origin.digest, "was damaged", origin.returns)
            for path, origin in self.damaged.items()
        }
        for path, scan in self.scans.items():
            source = recorded_source(scan)
            digest = None if source is None else _digest_now(self.context, source)
            if source is None or (digest == scan.digest and _is_read_so(scan, key(source))):
                continue
            if digest is None and _is_read_so(scan, key(source)):
                continue
            if digest is None:
                raise WorkspaceError(
                    f"scan {scan.name} has to be read again ([body] or [import] changed), but its "
                    "file is gone",
                    source.path,
                    "restore the file or the settings",
                )
            if digest == scan.digest:
                due[path] = Due(source, digest)
            else:
                due[path] = Due(
                    source, digest, f"had {scan.count} returns before its file changed", scan.count
                )
        return due

    def taken(self, due: Mapping[Path, Due], made: Mapping[Path, ScanSummary]) -> list[str]:
        """Move scans that were read again from the scratch folder to their places.

        Returns
        -------
        list of str
            Messages about them.

        Raises
        ------
        WorkspaceError
            If a changed file gives fewer returns than before; then no scan is replaced.
        """
        accepted = Code.CHANGED_INPUT in self.context.settings.accept.codes
        scratch, root = self.context.scratch, self.context.workspace.root
        for path, scan in made.items():
            if scan.count < due[path].least and not accepted:
                for each in made:
                    (scratch / each.name).unlink(missing_ok=True)
                raise WorkspaceError(
                    f"has changed since it was imported as {path.stem} and gives {scan.count} "
                    f"returns, {due[path].least} before",
                    due[path].source.path,
                    f"restore it, or take it as it is: spcola import {root} "
                    f"{due[path].source.path}",
                )
        for path in made:
            (scratch / path.name).replace(path)
        return [
            f"scan {path.stem} {one.why} and was read again from {one.source.path}: "
            f"{made[path].count} returns"
            for path, one in due.items()
            if one.why
        ]


def _unchanged_origin(context: StageContext, path: Path, origin: Origin | None) -> Origin:
    """Return the unchanged file from which a damaged scan can be read again.

    Raises
    ------
    WorkspaceError, FormatError
        If the file is unknown, gone or has changed.
    """
    if origin is None:
        # An unreadable scan raises its own error here.
        scan_summary(path)
        raise WorkspaceError(
            f"has changed since stage {INGEST} wrote it, and its source file is not known",
            path,
            f"restore it, or continue with --accept {Code.CHANGED_INPUT}",
        )
    now = _digest_now(context, origin.source)
    if now == origin.digest:
        return origin
    state = "gone" if now is None else "changed too"
    raise WorkspaceError(
        f"has changed since stage {INGEST} wrote it, and its source {origin.source.path} is "
        f"{state}",
        path,
        "restore one of them, or remove the scan and import its source again",
    )


def _digest_now(context: StageContext, source: LidarFile) -> str | None:
    """Return the digest of a source; None if it is gone."""
    return context.inputs.get(context.workspace.relative(source.path))


def _is_read_so(scan: ScanSummary, key: str) -> bool:
    return scan.parameters.get("import_key") == key
