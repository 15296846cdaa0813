"""``spcola truth assess``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from fusion.cli.options import JsonOption, WorkersOption, WorkspaceArgument
from fusion.cli.output import show


def assess(
    workspace: WorkspaceArgument,
    truth: Annotated[
        Path,
        typer.Option(metavar="DIR", help="The synthetic mission (the folder of its truth.json)."),
    ],
    model: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="Another model to assess: .MAP, FITS, GeoTIFF, OBJ, PLY, ICQ, or the folder of a "
            "release. Repeat it for several.",
        ),
    ] = None,
    frame: Annotated[
        Literal["spc", "body"],
        typer.Option(
            help="Coordinates of the models of --model: those of the SPC solution (spc), or the "
            "true body-fixed ones, which are the lidar's (body)."
        ),
    ] = "spc",
    unit: Annotated[
        Literal["km", "m"], typer.Option(help="Unit of an OBJ or PLY of --model that states none.")
    ] = "km",
    only: Annotated[
        bool, typer.Option("--only", help="Assess the models of --model, not those of WS.")
    ] = False,
    patches: Annotated[
        int,
        typer.Option(
            metavar="N",
            min=1,
            max=1_000_000,
            help="Most maplets whose heights are compared.",
        ),
    ] = 200,
    vertices: Annotated[
        int,
        typer.Option(
            metavar="N", min=1, max=100_000_000, help="Most vertices of a model in its 3D rms."
        ),
    ] = 40_000,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE.html", help="Write a page of figures to this file.")
    ] = None,
    workers: WorkersOption = None,
    as_json: JsonOption = False,
) -> None:
    """Compare models with the truth of a synthetic mission.

    Prints 3D rms and optimised 3D rms, height errors by region, slopes, resolution, calibration of
    the stated sigmas, FormU, and recovered against planted parameters.
    """
    # Imported here and not above, so that --help is fast.
    from fusion.runtime import Progress, ThreadExecutor
    from fusion.truth import read_truth
    from fusion.truth.assessment import (
        AssessmentSettings,
        assessment_json,
        assessment_lines,
        file_model,
        workspace_models,
        write_page,
    )
    from fusion.truth.assessment import assess as assess_models
    from fusion.workspace import Workspace

    if only and not model:
        raise typer.BadParameter("needs --model", param_hint="--only")
    there, planted = Workspace.open(workspace), read_truth(truth)
    models = [] if only else workspace_models(there)
    models += [file_model(path, frame=frame, unit=unit) for path in model or []]
    dark = planted.settings.solution.darkness.dark
    settings = AssessmentSettings(patches=patches, vertices=vertices, dark_share=dark)
    executor, progress = ThreadExecutor(workers), Progress.fitting(silent=as_json)
    found = assess_models(planted, models, there, executor, progress, settings=settings)
    lines = list(assessment_lines(found))
    if report is not None:
        write_page(report, found)
        lines.append(f"report: {report.resolve()}")
    show(assessment_json(found), lines, as_json=as_json)
