"""``spcola init`` and ``spcola info``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from fusion.cli.options import FACES_FROM, IsolateOptions, JsonOption
from fusion.cli.output import show, value_lines

if TYPE_CHECKING:
    from fusion.runtime.folders import Listing


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
    disk for each of these. A few of their items are made to measure the time, and kept. Nothing is
    looked at again as long as no file changes.
    """
    isolation.apply(path)
    if path.is_dir():
        content, lines = _workspace_info(path)
    else:
        from fusion.inspection import describe_file

        content = describe_file(path, faces_from=0 if faces_from == 0 else 1)
        lines = value_lines(content)
    show(content, [str(path), *lines], as_json=as_json)


def _workspace_info(path: Path) -> tuple[dict[str, Any], list[str]]:
    """Return content and lines about a workspace: remembered, or found out now."""
    # What is remembered needs few of the program's modules, which take a second to import.
    from fusion.runtime.folders import Remembered

    remembered = Remembered(path)
    before = remembered.listing()
    if found := remembered.find(before, known=_with_known_states):
        return found["content"], found["lines"]
    from fusion.inspection import describe_workspace, outside_files
    from fusion.inspection.forecasts import forecast_json, forecast_lines, stage_forecasts
    from fusion.workspace import Workspace

    opened = Workspace.open(path)
    content, settings = describe_workspace(opened), opened.settings()
    lines = value_lines(content)
    # No forecast for a workspace whose stages refuse it.
    known = content["stages"]
    forecasts = {} if content["problems"] else stage_forecasts(opened, settings, states=known)
    details = forecasts["mapolas"].details if forecasts else {}
    content |= {"mapolas_forecast": dict(details), "forecast": forecast_json(forecasts)}
    if forecasts:
        lines += ["  forecast:", *(f"    {line}" for line in forecast_lines(content["forecast"]))]
    kept = {"content": content, "lines": lines, "home": opened.home}
    remembered.keep(before, kept, outside_files(opened, settings))
    return content, lines


def _with_known_states(now: Listing, kept: Mapping[str, Any]) -> Listing:
    """Return the listing with the earlier states of files whose content is what it was."""
    from fusion.pipeline.catalog import with_known_states

    # An earlier version of the program kept no home.
    return with_known_states(now, Path(kept["home"])) if "home" in kept else now
