"""What ``spcola import`` does: lidar files into a workspace."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fusion.service.commands.fields import Mark, named_columns
from fusion.service.commands.site import Done, Site

if TYPE_CHECKING:
    from fusion.stages.ingest import Imported

__all__ = ["ImportOptions", "import_lidar"]


@dataclass(frozen=True)
class ImportOptions:
    """Options of ``spcola import``."""

    files: Annotated[list[Path], typer.Argument(metavar="FILE", help="Lidar files.")]
    format: Annotated[
        str,
        typer.Option(
            metavar="F",
            help="native, las, cloud, ola, table, lola, hayabusa, hayabusa2, nlr or track; "
            "recognised by content if not given.",
        ),
    ] = ""
    columns: Annotated[
        list[str] | None,
        typer.Option(
            metavar="QUANTITY=COLUMN",
            help="For tables: the column of a quantity, with its unit, such as 'x=X [km]'. Repeat "
            "it for each column.",
        ),
        Mark.COLUMNS,
    ] = None
    unit: Annotated[
        str,
        typer.Option(metavar="m|km|cm|mm", help="Unit of coordinates, if not in the file."),
    ] = ""
    name: Annotated[
        str,
        typer.Option(
            metavar="NAME", help="Name of the scan (one file only); by default the file's name."
        ),
    ] = ""
    gps_time: Annotated[
        bool, typer.Option("--gps-time", help="Keep the GPS time of LAS files.")
    ] = False

    def check(self) -> None:
        """Refuse options that contradict each other.

        Raises
        ------
        typer.BadParameter
        """
        if self.name and len(self.files) > 1:
            raise typer.BadParameter("names one file only", param_hint="--name")
        self.renamed()

    def renamed(self) -> dict[str, str]:
        """Return the columns of a table by their quantities."""
        parts = (part for text in self.columns or () for part in text.split(","))
        return named_columns(parts, "QUANTITY=COLUMN")


def import_lidar(site: Site, given: ImportOptions) -> Done:
    """Read lidar files into the workspace."""
    from fusion.stages import import_scans
    from fusion.stages.ingest import LidarFile

    given.check()
    form = (given.format, given.renamed(), given.unit, given.gps_time)
    done = import_scans(
        site.open(),
        [LidarFile(file, given.name, *form) for file in given.files],
        executor=site.executor,
        progress=site.progress,
    )
    return Done({"scans": [one.as_dict() for one in done]}, [_line(one) for one in done])


def _line(done: Imported) -> str:
    """Return the line about one imported file."""
    rejected = ", ".join(f"{count} {reason}" for reason, count in done.scan.rejected.items())
    kind = done.scan.parameters.get("format", "")
    return (
        f"{done.source.path}: {done.state} as {done.scan.name} ({kind}), {done.scan.count} returns"
        + (f" ({done.before} before)" if done.state == "imported again" else "")
        + (f", rejected: {rejected}" if rejected else "")
    )
