"""``spcola demo``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fusion.cli.options import JsonOption, WorkersOption
from fusion.cli.output import show


def demo(
    folder: Annotated[
        Path,
        typer.Argument(metavar="DIR", help="A new or empty folder, or that of an earlier demo."),
    ] = Path("spcola-demo"),
    workers: WorkersOption = None,
    as_json: JsonOption = False,
) -> None:
    """Run the whole processing on a small synthetic body.

    Lidar scans that leave gaps and an SPC solution with a pole in shadow are made of a known body,
    with planted errors. All stages run; recovered and planted parameters are printed side by side,
    with a line on each that differs by more than three sigma, and the errors of the heights of SPC,
    lidar and both.
    """
    # Imported here and not above, so that --help is fast.
    from fusion.runtime import Progress, ThreadExecutor
    from fusion.truth import demonstrate, errors_table, recovery_table

    progress = Progress.fitting(silent=as_json)
    shown = demonstrate(folder, ThreadExecutor(workers), progress)
    ran = [f"{run.stage}: {run.state} ({run.seconds:.1f} s)" for run in shown.runs]
    lines = [
        *ran,
        "",
        *recovery_table(shown.recovered),
        "",
        *errors_table(shown.errors),
        "",
        f"workspace: {shown.workspace.root}",
        f"report: {shown.workspace.report_path.resolve()}",
    ]
    show(shown.as_dict(), lines, as_json=as_json)
