"""``spcola import``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from fusion.cli.options import (
    ClusterOption,
    IsolateOptions,
    JsonOption,
    WorkersOption,
    WorkspaceArgument,
    executor_of,
    named_columns,
    shared_path,
)
from fusion.cli.output import show


def import_(
    workspace: WorkspaceArgument,
    files: Annotated[list[Path], typer.Argument(metavar="FILE", help="Lidar files.")],
    format: Annotated[
        str,
        typer.Option(
            metavar="F",
            help="native, las, cloud, ola, table, lola, hayabusa, hayabusa2, nlr or track; "
            "recognised by content if not given.",
        ),
    ] = "",
    columns: Annotated[
        list[str] | None,
        typer.Option(
            metavar="QUANTITY=COLUMN",
            help="For tables: the column of a quantity, with its unit, such as 'x=X [km]'. Repeat "
            "it for each column.",
        ),
    ] = None,
    unit: Annotated[
        str,
        typer.Option(metavar="m|km|cm|mm", help="Unit of coordinates, if not in the file."),
    ] = "",
    name: Annotated[
        str,
        typer.Option(
            metavar="NAME", help="Name of the scan (one file only); by default the file's name."
        ),
    ] = "",
    gps_time: Annotated[
        bool, typer.Option("--gps-time", help="Keep the GPS time of LAS files.")
    ] = False,
    workers: WorkersOption = None,
    cluster: ClusterOption = "",
    isolation: IsolateOptions = IsolateOptions(),
    as_json: JsonOption = False,
) -> None:
    """Read lidar files into the workspace.

    Shots without an echo, returns flagged as bad and returns far from the shape are left out and
    counted by reason. A file that was imported before is recognised by its content.
    """
    # Imported here and not above, so that --help is fast.
    from fusion.runtime import Progress
    from fusion.stages import import_scans
    from fusion.stages.ingest import LidarFile
    from fusion.workspace import Workspace

    isolation.apply(workspace)
    if name and len(files) > 1:
        raise typer.BadParameter("names one file only", param_hint="--name")
    there = Workspace.open(shared_path(workspace, cluster))
    settings = there.settings()
    parts = (part for text in columns or () for part in text.split(","))
    form = (format, named_columns(parts, "QUANTITY=COLUMN"), unit, gps_time)
    sources = [LidarFile(shared_path(file, cluster), name, *form) for file in files]
    workforce, progress = executor_of(workers, cluster), Progress.fitting(silent=as_json)
    done = import_scans(there, sources, settings=settings, executor=workforce, progress=progress)
    content = {"scans": [one.as_dict() for one in done]}
    show(content, scan_lines(content), as_json=as_json)


def scan_lines(content: Mapping[str, Any]) -> list[str]:
    """Return the lines about imported files, from the JSON."""
    return [_line(one) for one in content["scans"]]


def _line(done: Mapping[str, Any]) -> str:
    """Return the line about one imported file."""
    rejected = ", ".join(f"{count} {reason}" for reason, count in done["rejected"].items())
    again = f" ({done['returns_before']} before)" if done["state"] == "imported again" else ""
    return (
        f"{done['file']}: {done['state']} as {done['scan']} ({done['format']}), "
        f"{done['returns']} returns{again}" + (f", rejected: {rejected}" if rejected else "")
    )
