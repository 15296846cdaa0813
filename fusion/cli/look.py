"""``spcola look``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fusion.cli.options import IsolateOptions, JsonOption
from fusion.cli.output import show
from fusion.service.commands.looking import ShapeOptions, draw


def look(
    path: Annotated[
        Path, typer.Argument(metavar="FILE|WS", help="A workspace, or a file of any kind.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--out",
            metavar="PNG",
            help="Where to write the picture (.png, .pdf or .svg); NAME.png in the current folder "
            "if not given.",
        ),
    ] = None,
    shape: ShapeOptions = ShapeOptions(),
    isolation: IsolateOptions = IsolateOptions(),
    as_json: JsonOption = False,
) -> None:
    """Draw what a file or a workspace holds.

    Heights and shaded relief of maplets, mapolas, fused maplets, bigmaps and pairs; footprints of
    lidar files and scans; three views of shapes; images with their landmarks; residuals of
    registration.json, and scale.json; an overview of a workspace. A file of the name NAME.png that
    was not made by this command is not replaced; a file named with -o is.
    """
    from fusion.inspection.look import picture_path

    isolation.apply(path)
    target = picture_path(path, out)
    show(draw(path, target, shape), [str(target)], as_json=as_json)
