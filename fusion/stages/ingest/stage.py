"""Import: scans of the workspace from lidar files, each one HDF5 file."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fusion.pipeline import Stage, StageContext, StageResult
from fusion.pipeline.catalog import Catalog
from fusion.runtime import Executor, Progress, content_digest
from fusion.runtime.machine import forget_pages, one_blas_thread
from fusion.stages.ingest.lidar_files import (
    INGEST,
    LidarFile,
    Origin,
    check_duplicates,
    readable,
    readable_scans,
    recorded_origins,
    recorded_source,
)
from fusion.stages.ingest.repair import Repair
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings
from fusion.workspace.settings.inputs import BodySettings, ImportSettings
from lidar.formats import open_lidar, recognise
from lidar.formats.native import write_scan
from lidar.formats.records import LidarOptions
from lidar.scans import ScanSummary
from spcola.arrays import FloatArray
from spcola.errors import WorkspaceError
from spcola.navigation import utc_from_et

_ALREADY = "imported already"


@dataclass(frozen=True)
class Imported:
    """Outcome of one file: "imported", "imported already" or "imported again".

    `before` is the number of returns that its scan had, None if it is new.
    """

    source: LidarFile
    state: str
    scan: ScanSummary
    before: int | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return the content of ``--json``."""
        return {
            "file": str(self.source.path),
            "state": self.state,
            "format": self.scan.parameters.get("format", ""),
            **scan_facts(self.scan),
            "returns_before": self.before,
        }


@one_blas_thread()
def import_files(
    workspace: Workspace,
    settings: Settings,
    sources: Sequence[LidarFile],
    catalog: Catalog,
    *,
    executor: Executor,
    progress: Progress,
) -> list[Imported]:
    """Import files; those imported already, by digest and options, are skipped.

    Errors that need no reading of returns are raised before anything is written.

    Parameters
    ----------
    workspace : Workspace
    settings : Settings
    sources : sequence of LidarFile
    catalog : Catalog
        The open catalogue of the workspace, for digests of files.
    executor : Executor
    progress : Progress

    Raises
    ------
    WorkspaceError
        If two files would get the same name, or a file cannot be read.
    FormatError
        If a file does not have the content of its format.
    """
    for source in sources:
        _check_name(source)
    # A damaged scan may be replaced by its source.
    scans = readable_scans(workspace)
    with catalog.digesting([source.path for source in sources]) as digests:
        # The shape is read while digests of the first files are computed.
        importer = _Importer(workspace, settings, scans, radius_limits(workspace, settings))
        there = _sources_there(workspace, scans)
        items = _placed(sources, digests, there)
        if _may_collide(sources, there):
            items = iter(list(items))
        done = []
        with progress.task("import", len(sources)) as task:
            for imported in executor.stream(importer, items):
                done.append(imported)
                task.kept += imported.state != _ALREADY
                task.advance()
    return done


def _may_collide(sources: Sequence[LidarFile], there: Collection[str]) -> bool:
    """Return whether names of sources are not unique, so that digests must distinguish them."""
    names = [source.scan_name for source in sources]
    return len(set(names)) < len(names) or not set(names).isdisjoint(there)


def _placed(
    sources: Sequence[LidarFile],
    digests: Iterator[str],
    there: Mapping[str, tuple[str, Path | None]],
) -> Iterator[tuple[LidarFile, str, str]]:
    """Yield each source with its digest and the name of its scan.

    `there` are digests and paths of the sources of existing scans, by name. A file that has changed
    since it was imported keeps the name of its scan.

    Raises
    ------
    WorkspaceError
        If its name is that of a scan of another file.
    """
    taken = {name: digest for name, (digest, _) in there.items()}
    came_from = {name: path for name, (_, path) in there.items()}
    for source, digest in zip(sources, digests, strict=True):
        same = [name for name, other in taken.items() if other == digest]
        its_own = came_from.pop(source.scan_name, None) == source.path.resolve()
        if not same and source.scan_name in taken and not its_own:
            raise WorkspaceError(
                f"the workspace has a scan {source.scan_name!r} of another file",
                source.path,
                "give this one another name with --name",
            )
        name = same[0] if same else source.scan_name
        taken[name] = digest
        yield source, digest, name


def _sources_there(
    workspace: Workspace, scans: Mapping[str, ScanSummary]
) -> dict[str, tuple[str, Path | None]]:
    """Return digests and paths of the files of all scans; for damaged scans from their record."""
    there: dict[str, tuple[str, Path | None]] = {}
    known = recorded_origins(workspace)
    for name in workspace.scan_names():
        scan = scans.get(name)
        origin = Origin.of(scan) if scan else known.get(name)
        if scan or origin:
            digest = scan.digest if scan else origin.digest if origin else ""
            there[name] = (digest, origin.source.path if origin else None)
    return there


@dataclass(frozen=True)
class _Importer:
    """Imports one file at a time; `scans` are the existing scans, by name."""

    workspace: Workspace
    settings: Settings
    scans: Mapping[str, ScanSummary]
    limits: tuple[float, float]

    def __call__(self, item: tuple[LidarFile, str, str]) -> Imported:
        """Import a source with its digest under a name, unless it is imported already."""
        source, digest, name = item
        before = self.scans.get(name)
        key = _key(source, self.settings)
        if before is not None and (before.parameters.get("import_key"), before.digest) == (
            key,
            digest,
        ):
            return Imported(source, _ALREADY, before, before.count)
        options = lidar_options(source, self.settings, name, self.limits)
        path = self.workspace.scan_path(name)
        scan = _write(path, options, source, self.settings, digest)
        if before is None:
            return Imported(source, "imported", scan)
        return Imported(source, "imported again", scan, before.count)


class IngestStage(Stage):
    """Keeps scans consistent with the settings: reads them again if these changed."""

    name = INGEST
    version = 2
    tables = (BodySettings, ImportSettings)

    def missing(self, workspace: Workspace, settings: Settings) -> str:
        """Return why there is nothing to do; empty if there is."""
        if workspace.scan_names():
            return ""
        return f"no lidar file was imported; run: spcola import {workspace.root} FILE"

    def inputs(self, workspace: Workspace, settings: Settings) -> list[Path]:
        """Return the existing source files of the scans, and the scans without one.

        The file of a damaged scan is taken from the record of its import. A scan that was not
        imported, or has another name than its file, is an input itself.
        """
        known, paths = recorded_origins(workspace), dict[Path, None]()
        for path in workspace.scan_paths():
            scan, origin = readable(path), known.get(path.stem)
            source = None if scan is None else recorded_source(scan)
            if scan is not None and (source is None or scan.name != path.stem):
                paths[path] = None
            for one in (source, None if origin is None else origin.source):
                if one is not None and _in_reach(one.path):
                    paths[one.path] = None
        return list(paths)

    def run(self, context: StageContext) -> StageResult:
        """Import again scans that were read with other settings, changed, or are damaged.

        Raises
        ------
        WorkspaceError
            If the file of such a scan is gone, two files hold the same scan, or something is
            lost: a scan, or returns of a changed file.
        """
        # Remote workers get what the function refers to: not the whole context.
        workspace, settings, scratch = context.workspace, context.settings, context.scratch
        repair = Repair.of(context)
        due = repair.due(lambda source: _key(source, settings))
        # The shape is read only if a scan is read.
        limits = radius_limits(workspace, settings) if due else (0.0, math.inf)

        def one(path: Path) -> ScanSummary:
            options = lidar_options(due[path].source, settings, path.stem, limits)
            source, digest = due[path].source, due[path].digest
            return _write(scratch / path.name, options, source, settings, digest)

        again = dict(zip(due, context.map("import", one, due), strict=True))
        notes = repair.taken(due, again)
        scans = {**repair.scans, **again}
        check_duplicates(workspace, {path.stem: scan for path, scan in scans.items()})
        rejected = {scan.name: dict(scan.rejected) for scan in scans.values() if scan.rejected}
        returns = sum(scan.count for scan in scans.values())
        origins = {path.stem: Origin.of(scan) for path, scan in scans.items()}
        sources = {name: origin.as_json() for name, origin in origins.items() if origin}
        summary: dict[str, Any] = {
            "scans": len(scans),
            "returns": returns,
            "rejected": rejected,
            "sources": sources,
        }
        if repair.verdict.findings:
            summary |= repair.verdict.as_json()
        return StageResult(tuple(scans), summary, tuple(notes))


STAGE = IngestStage()


def scan_facts(scan: ScanSummary) -> dict[str, Any]:
    """Return the main properties of a scan, in JSON types."""
    return {
        "scan": scan.name,
        "returns": scan.count,
        "rejected": dict(scan.rejected),
        **span_facts(scan.time_span),
        "trajectory": scan.trajectory,
        "body": scan.body,
        "lowest_m": scan.bounds[0].tolist(),
        "highest_m": scan.bounds[1].tolist(),
        "digest": scan.digest,
    }


def span_facts(span: Sequence[float] | FloatArray) -> dict[str, Any]:
    """Return the ends of a `span`, ephemeris s, and their UTC; None for the UTC of unknown ones."""
    first, last = (utc_from_et(time) if math.isfinite(time) else None for time in span)
    return {"first_et_s": span[0], "last_et_s": span[1], "first_utc": first, "last_utc": last}


def radius_limits(workspace: Workspace, settings: Settings) -> tuple[float, float]:
    """Return the limits of the radii of returns, metres.

    They come from the settings or else, if there is a shape, are a tenth of its smallest and ten
    times its largest radius: wide enough for all outliers, too narrow for a file in kilometres
    that is read as metres.
    """
    table = settings.ingest
    stated = (table.min_radius_m, table.max_radius_m or math.inf)
    if stated != (0.0, math.inf) or not workspace.has_shape():
        return stated
    radii = np.linalg.norm(workspace.shape().vertices, axis=1)
    return float(radii.min()) / 10.0, float(radii.max()) * 10.0


def lidar_options(
    source: LidarFile, settings: Settings, name: str, limits: tuple[float, float]
) -> LidarOptions:
    """Return the options for reading `source`; `limits` are those of the radius, metres."""
    table = settings.ingest
    return LidarOptions(
        name=name,
        body=settings.body.name,
        sigma_m=table.sigma_range_m or math.nan,
        chunk=table.chunk,
        columns=source.columns,
        unit=source.unit or None,
        gps_time=source.gps_time,
        range_tolerance_m=table.range_tolerance_m or None,
        radius_limits_m=None if limits == (0.0, math.inf) else limits,
    )


def _in_reach(path: Path) -> bool:
    """Return whether a file exists and its folder is accessible."""
    try:
        return path.is_file()
    except OSError:
        return False


def _check_name(source: LidarFile) -> None:
    """Refuse a scan's name with a path, or of a hidden file."""
    name = source.scan_name
    if Path(name).name != name or name.startswith(".") or not name.isprintable():
        raise WorkspaceError(
            f"{name!r} is no name for a scan",
            source.path,
            "give one with --name, without a slash and not beginning with a dot",
        )


def _write(
    path: Path, options: LidarOptions, source: LidarFile, settings: Settings, digest: str
) -> ScanSummary:
    """Read `source` and write it as the scan `path`, with its source."""
    # Columns are stated for tables only, and a table with unknown names is not recognised.
    chosen = source.format or ("table" if source.columns else recognise(source.path))
    chunks = open_lidar(source.path, format=chosen, options=options)
    parameters: dict[str, str | float | int] = {
        "source": str(source.path.resolve()),
        "format": chosen,
        "columns": json.dumps(dict(source.columns)),
        "unit": source.unit,
        "gps_time": int(source.gps_time),
        "import_key": _key(source, settings),
    }
    scan = write_scan(path, chunks, digest=digest, parameters=parameters)
    forget_pages(source.path)
    return scan


def _key(source: LidarFile, settings: Settings) -> str:
    """Return a digest of the options on which reading `source` depends."""
    return content_digest(
        {
            "columns": dict(source.columns),
            "unit": source.unit,
            "gps_time": source.gps_time,
            "body": settings.body.name,
            "import": settings.ingest.model_dump(mode="json", exclude={"chunk"}),
        }
    )
