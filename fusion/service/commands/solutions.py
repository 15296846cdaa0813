"""What ``spcola solution use``, ``export`` and ``remove`` do."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from fusion.service.commands.fields import Mark
from fusion.service.commands.site import Done, Site

__all__ = [
    "ExportOptions",
    "SolutionName",
    "check_named",
    "export_to_folder",
    "put_in_use",
    "remove_version",
]
NameArgument = Annotated[str, typer.Argument(metavar="NAME", help="A solution of the workspace.")]


@dataclass(frozen=True)
class SolutionName:
    """The solution that a command works on."""

    name: NameArgument

    def check(self) -> None:
        """Refuse no name; raises typer.BadParameter."""
        check_named(self.name)


@dataclass(frozen=True)
class ExportOptions(SolutionName):
    """A solution, and where it is written."""

    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A new folder."), Mark.OUTPUT]


def check_named(solution: str) -> None:
    """Refuse no name of a solution: it would be the one in use; raises typer.BadParameter."""
    if not solution:
        raise typer.BadParameter("is empty", param_hint="NAME")


def put_in_use(site: Site, given: SolutionName) -> Done:
    """Let all commands read a solution from now on."""
    from fusion.pipeline.solutions import use_solution
    from fusion.workspace import IMPORTED

    given.check()
    used = use_solution(site.open(IMPORTED), given.name)
    return Done({"in_use": used.solution}, [f"in use: {used.solution}"])


def export_to_folder(site: Site, given: ExportOptions) -> Done:
    """Write a solution as a plain SPC folder."""
    from fusion.pipeline.solutions import export_solution

    given.check()
    folder = given.folder
    counts, cameras = export_solution(site.open(given.name), folder)
    listed = ", ".join(f"{count} in {each}" for each, count in counts.items())
    fits = [{"file": file, **one.as_json()} for file, one in cameras.items()]
    lines = [f"  {file}: {one.text}" for file, one in cameras.items()]
    content: dict[str, Any] = {"folder": folder, "written": counts, "cameras": fits}
    return Done(content, [f"{folder}: {listed}", *lines])


def remove_version(site: Site, given: SolutionName) -> Done:
    """Remove a solution and its results."""
    from fusion.pipeline.solutions import remove_solution
    from fusion.workspace import IMPORTED

    given.check()
    remove_solution(site.open(IMPORTED), given.name, job=site.job)
    return Done({"removed": given.name}, [f"removed: {given.name}"])
