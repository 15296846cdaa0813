"""``spcola solution``: versions of the SPC solution of a workspace."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from fusion.cli.options import JsonOption, WorkspaceArgument, site_of, with_shared_options
from fusion.cli.output import show
from fusion.cli.program import guarded
from fusion.service.commands.looking import DifferenceOptions, compare_solutions
from fusion.service.commands.solutions import (
    ExportOptions,
    NameArgument,
    SolutionName,
    check_named,
    export_to_folder,
    put_in_use,
    remove_version,
)

if TYPE_CHECKING:
    from fusion.workspace import Workspace

app = typer.Typer(
    name="solution",
    help="List, choose, compare, export and remove versions of the SPC solution.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


def list_(workspace: WorkspaceArgument, as_json: JsonOption = False) -> None:
    """List the solutions of a workspace, each below the one that it was made from."""
    from fusion.pipeline.solutions import solutions_of
    from fusion.workspace import IMPORTED
    from fusion.workspace.solution_records import name_in_use

    opened, in_use = _opened(workspace, IMPORTED), name_in_use(workspace)
    found = solutions_of(opened)
    damaged = [str(error) for error in found.damaged]
    content = {
        "in_use": in_use,
        "solutions": [one.as_json() for one in found.records],
        "damaged": damaged,
    }
    show(*listed(content), as_json=as_json)


def listed(content: dict[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """Return what ``solution list`` prints: its JSON, in which a lost solution is damaged."""
    depth, lines, in_use = {"": -1}, [], content["in_use"]
    for one in content["solutions"]:
        depth[one["name"]] = depth.get(one["parent"], -1) + 1
        mark = "*" if one["name"] == in_use else " "
        about = ", ".join(part for part in (one["made_by"], one["made"]) if part)
        lines.append(f"{mark} {'  ' * depth[one['name']]}{one['name']} ({about})")
    damaged = list(content["damaged"])
    if in_use not in depth and not damaged:
        damaged = [f"{in_use!r}, which is in use, is not there; choose one: spcola solution use"]
    lines += ["* in use", *(f"damaged: {each}" for each in damaged)]
    return {**content, "damaged": damaged}, lines


def show_(workspace: WorkspaceArgument, name: NameArgument, as_json: JsonOption = False) -> None:
    """Show what a solution was made from, by what and when, and what it holds."""
    from fusion.cli.output import value_lines
    from fusion.inspection import describe_solution

    opened = _opened(workspace, name)
    content = {**describe_solution(opened), "folder": opened.home}
    show(content, value_lines(content), as_json=as_json)


def use(workspace: WorkspaceArgument, given: SolutionName, as_json: JsonOption = False) -> None:
    """Let all commands read this solution from now on; --solution chooses for one command."""
    show(*put_in_use(site_of(workspace, as_json=as_json), given), as_json=as_json)


def diff(
    workspace: WorkspaceArgument, given: DifferenceOptions, as_json: JsonOption = False
) -> None:
    """Compare two solutions: how far B moved from A.

    Centres, heights within maplets, positions and pointing of images, the similarity that all
    centres have in common, shape, pole and other constants.
    """
    from fusion.inspection.look import picture_path

    if given.out is not None:
        picture_path(workspace, given.out)
    show(*compare_solutions(site_of(workspace, as_json=as_json), given), as_json=as_json)


def export(workspace: WorkspaceArgument, given: ExportOptions, as_json: JsonOption = False) -> None:
    """Write a solution as a plain SPC folder, with the pixels of its images.

    Where a camera's distortion is not Owen's, the .SUM files have a fit to it; how good it is, is
    printed, and the exact cameras are written too.
    """
    show(*export_to_folder(site_of(workspace, as_json=as_json), given), as_json=as_json)


def remove(workspace: WorkspaceArgument, given: SolutionName, as_json: JsonOption = False) -> None:
    """Remove a solution and its results; not one in use, or from which another was made."""
    show(*remove_version(site_of(workspace, as_json=as_json), given), as_json=as_json)


for _name, _command, _example in (
    ("list", list_, "spcola solution list bennu"),
    ("show", show_, "spcola solution show bennu scaled-1"),
    ("use", use, "spcola solution use bennu scaled-1"),
    ("diff", diff, "spcola solution diff bennu imported scaled-1 -o diff.png"),
    ("export", export, "spcola solution export bennu scaled-1 /data/spc-scaled"),
    ("remove", remove, "spcola solution remove bennu scaled-1"),
):
    app.command(_name, epilog=f"Example: {_example}")(guarded(with_shared_options(_command)))


def _opened(workspace: Path, name: str) -> Workspace:
    """Open a workspace with the solution `name`.

    Raises
    ------
    typer.BadParameter
        If it has no name: it would be the one in use.
    """
    from fusion.workspace import Workspace

    check_named(name)
    return Workspace.open(workspace, name)
