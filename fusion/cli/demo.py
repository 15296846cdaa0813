"""``spcola demo``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fusion.cli.output import JsonOption, show
from fusion.cli.stages import WorkersOption


def demo(
    folder: Annotated[
        Path,
        typer.Argument(metavar="DIR", help="A new or empty folder, or that of an earlier demo."),
    ] = Path("spcola-demo"),
    workers: WorkersOption = None,
    as_json: JsonOption = False,
) -> None:
    """Run the whole processing on a small synthetic body.

    Lidar scans and an SPC solution of a known body are made, with planted errors. All stages run;
    recovered and planted parameters are printed side by side.
    """
    # Imported here and not above, so that --help is fast.
    from fusion.runtime import Progress, ThreadExecutor
    from fusion.truth import demonstrate, recovery_table

    progress = Progress.fitting(silent=as_json)
    shown = demonstrate(folder, ThreadExecutor(workers), progress)
    ran = [f"{run.stage}: {run.state} ({run.seconds:.1f} s)" for run in shown.runs]
    lines = [
        *ran,
        "",
        *recovery_table(shown.recovered),
        "",
        f"workspace: {shown.workspace.root}",
        f"report: {shown.workspace.report_path.resolve()}",
    ]
    show(shown.as_dict(), lines, as_json=as_json)
