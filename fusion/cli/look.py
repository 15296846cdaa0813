"""``spcola look``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from fusion.cli.options import FACES_FROM, IsolateOptions, JsonOption
from fusion.cli.output import show


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
    unit: Annotated[
        Literal["km", "m"] | None,
        typer.Option(help="Unit of the coordinates of an OBJ or PLY shape; km if not given."),
    ] = None,
    faces_from: Annotated[int | None, FACES_FROM] = None,
    isolation: IsolateOptions = IsolateOptions(),
    as_json: JsonOption = False,
) -> None:
    """Draw what a file or a workspace holds.

    Heights and shaded relief of maplets, mapolas, fused maplets, bigmaps and pairs; footprints of
    lidar files and scans; three views of shapes; images with their landmarks; residuals of
    registration.json, and scale.json; an overview of a workspace. A file of the name NAME.png that
    was not made by this command is not replaced; a file named with -o is.
    """
    # The machinery is imported here and not above, so that help comes at once.
    from fusion.inspection.look import LookOptions, look_at, picture_path, save_picture

    isolation.apply(path)
    target = picture_path(path, out)
    options = LookOptions(unit, None if faces_from is None else 0 if faces_from == 0 else 1)
    picture = look_at(path, options)
    save_picture(picture, target)
    content = {"source": path, "picture": target, "kind": picture.kind, **picture.facts}
    show(content, [str(target)], as_json=as_json)
