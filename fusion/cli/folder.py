"""``spcola init`` and ``spcola info``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from fusion.cli.options import FACES_FROM, IsolateOptions, JsonOption
from fusion.cli.output import show, value_lines


def init(
    workspace: Annotated[Path, typer.Argument(metavar="WS", help="The folder of the workspace.")],
    spc: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="An SPC working folder (MAPFILES, LMKFILES, SUMFILES ...). Its files are linked "
            "into the workspace, not copied. WS may be the same folder.",
        ),
    ] = None,
    shape: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="A shape model (ICQ, OBJ or PLY); it is copied."),
    ] = None,
    unit: Annotated[
        Literal["km", "m"], typer.Option(help="Unit of the coordinates of an OBJ or PLY shape.")
    ] = "km",
    faces_from: Annotated[int, FACES_FROM] = 1,
    body: Annotated[str, typer.Option(metavar="NAME", help="Name of the body.")] = "body",
    isolation: IsolateOptions = IsolateOptions(),
    as_json: JsonOption = False,
) -> None:
    """Make a workspace: folders and settings.

    All settings, with defaults and meanings, are written to spcola.toml. Existing files in the
    folder are unchanged.
    """
    # Imported here and not above, so that --help is fast.
    from fusion.inspection import describe_workspace
    from fusion.workspace import SETTINGS_FILE, new_workspace

    isolation.apply(workspace)
    if spc is not None and shape is not None:
        raise typer.BadParameter("give --spc or --shape, not both", param_hint="--shape")
    made = new_workspace(
        workspace,
        body=body,
        spc=spc,
        shape=shape,
        shape_unit=unit,
        faces_from=0 if faces_from == 0 else 1,
    )
    content = describe_workspace(made)
    lines = [
        f"Made {made.root} ({body}): {content['maplets']} maplets, {content['landmarks']} "
        f"landmarks, {content['images']} images, shape: {content['shape'] or 'none'}",
        f"Its settings are in {made.root / SETTINGS_FILE}. Next: spcola import {made.root} FILE...",
    ]
    if shape is not None and (remark := made.shape().remark):
        lines.append(f"The shape: {remark} ([body] icq_edges).")
    show(content, lines, as_json=as_json)


def info(
    path: Annotated[
        Path, typer.Argument(metavar="WS|FILE", help="A workspace, or any file SPCOLA reads.")
    ],
    faces_from: Annotated[int, FACES_FROM] = 1,
    isolation: IsolateOptions = IsolateOptions(),
    as_json: JsonOption = False,
) -> None:
    """Describe a workspace or a file.

    Of a workspace: its content, stages that are not up to date, and a forecast of time, memory and
    disk for making mapolas. A few mapolas are made and discarded to measure the time.
    """
    from fusion.inspection import describe_file, describe_workspace, mapolas_forecast
    from fusion.workspace import Workspace

    isolation.apply(path)
    if path.is_dir():
        opened = Workspace.open(path)
        content = describe_workspace(opened)
        # No forecast for mapolas that cannot be made.
        sound = not content["problems"]
        content["mapolas_forecast"] = mapolas_forecast(opened, opened.settings()) if sound else {}
    else:
        content = describe_file(path, faces_from=0 if faces_from == 0 else 1)
    show(content, [str(path), *value_lines(content)], as_json=as_json)
