"""What ``spcola look``, ``info`` of a file, and ``solution diff`` do."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal

import typer

from fusion.service.commands.fields import FACES_FROM, Mark
from fusion.service.commands.site import Done, Site
from fusion.service.commands.solutions import check_named
from spcola.errors import WorkspaceError

__all__ = [
    "DifferenceOptions",
    "InfoOptions",
    "LookOptions",
    "ShapeOptions",
    "compare_solutions",
    "describe",
    "draw",
    "draw_in_workspace",
]
_SUFFIXES = (".png", ".pdf", ".svg")


@dataclass(frozen=True)
class ShapeOptions:
    """What an OBJ or PLY shape does not state about its coordinates."""

    unit: Annotated[
        Literal["km", "m"] | None,
        typer.Option(help="Unit of the coordinates of an OBJ or PLY shape; km if not given."),
    ] = None
    faces_from: Annotated[int | None, FACES_FROM] = None


@dataclass(frozen=True)
class LookOptions:
    """Parameters of a job ``look``."""

    out: Annotated[
        Path, typer.Option(metavar="PNG", help="The picture: .png, .pdf or .svg."), Mark.OUTPUT
    ]
    file: Annotated[
        str,
        typer.Option(
            metavar="FILE",
            help="A file in the workspace, such as MAPFILES/AB0001.MAP; by default all of it.",
        ),
    ] = ""
    shape: ShapeOptions = ShapeOptions()

    def check(self) -> None:
        """Refuse a name that is none of a picture, or of no file; raises typer.BadParameter."""
        _check_picture(self.out)
        _check_inside(self.file)


@dataclass(frozen=True)
class InfoOptions:
    """Parameters of a job ``info``."""

    file: Annotated[
        str,
        typer.Option(metavar="FILE", help="A file in the workspace, such as MAPFILES/AB0001.MAP."),
    ]
    faces_from: Annotated[int, FACES_FROM] = 1

    def check(self) -> None:
        """Refuse the name of no file; raises typer.BadParameter."""
        _check_inside(self.file)


@dataclass(frozen=True)
class DifferenceOptions:
    """Options of ``spcola solution diff``."""

    first: Annotated[str, typer.Argument(metavar="A", help="A solution.")]
    second: Annotated[str, typer.Argument(metavar="B", help="The one that A is compared with.")]
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="FILE", help="Write a picture: .png, .pdf or .svg."),
        Mark.OUTPUT,
    ] = None

    def check(self) -> None:
        """Refuse no name of a solution, or of a picture; raises typer.BadParameter."""
        check_named(self.first)
        check_named(self.second)
        if self.out is not None:
            _check_picture(self.out)


def draw(source: Path, target: Path, shape: ShapeOptions) -> dict[str, Any]:
    """Draw what a file or a workspace holds; return what was drawn."""
    # The machinery is imported here and not above, so that help comes at once.
    from fusion.inspection.look import LookOptions as Chosen
    from fusion.inspection.look import look_at, save_picture

    numbered: Any = shape.faces_from
    picture = look_at(source, Chosen(shape.unit, numbered))
    save_picture(picture, target)
    return {"source": source, "picture": target, "kind": picture.kind, **picture.facts}


def draw_in_workspace(site: Site, given: LookOptions) -> Done:
    """Draw what the workspace or a file in it holds."""
    given.check()
    # In a process of its own: the file may be a user's.
    drawn = partial(draw, target=given.out, shape=given.shape)
    (content,) = site.executor.stream(drawn, [_source(site, given.file)])
    return Done(content, [str(given.out)])


def describe(site: Site, given: InfoOptions) -> Done:
    """Describe a file in the workspace."""
    from fusion.inspection import describe_file

    given.check()
    described = partial(describe_file, faces_from=0 if given.faces_from == 0 else 1)
    (content,) = site.executor.stream(described, [_source(site, given.file)])
    return Done(content, [])


def compare_solutions(site: Site, given: DifferenceOptions) -> Done:
    """Compare two solutions: how far the second moved from the first."""
    from fusion.inspection import difference_lines, solution_difference
    from fusion.inspection.look import difference_picture, save_picture

    given.check()
    found = solution_difference(site.open(given.first), site.open(given.second))
    content = {**found.as_json(), "picture": given.out}
    lines = list(difference_lines(content))
    if given.out is not None:
        save_picture(difference_picture(found), given.out)
        lines.append(str(given.out))
    return Done(content, lines)


def _source(site: Site, file: str) -> Path:
    """Return the path of a file in the workspace, or of the workspace.

    Raises
    ------
    WorkspaceError
        If there is no such file, it is hidden, or a link leads out of the workspace.
    """
    if not file:
        return site.root
    from fusion.service.state import visible_file

    found = visible_file(site.root, file)
    if found is None:
        raise WorkspaceError("is no file in the workspace", file)
    return found


def _check_picture(path: Path) -> None:
    if path.suffix.lower() not in _SUFFIXES:
        text = f"{path.name!r} is no name of a picture; end it with {', '.join(_SUFFIXES)}"
        raise typer.BadParameter(text, param_hint="--out")


def _check_inside(file: str) -> None:
    parts = PurePosixPath(file).parts
    if any(part.startswith(("/", ".")) for part in parts):
        raise typer.BadParameter("is no name of a file in the workspace", param_hint="FILE")
