"""``spcola demo``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fusion.cli.output import JsonOption, show
from fusion.cli.stages import WorkersOption


def demo(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="An empty folder, or that of an earlier demo.")
    ] = Path("spcola-demo"),
    workers: WorkersOption = None,
    as_json: JsonOption = False,
) -> None:
    """Run the main job on a small synthetic body.

    Lidar scans and an SPC solution are made of a body that is known, with errors planted in them;
    all stages run; what they recover is printed beside what was planted.
    """
    # The machinery is imported here and not above, so that help comes at once.
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
