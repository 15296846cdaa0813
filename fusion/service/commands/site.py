"""Where a command works, and what comes of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from spcola.errors import InvalidValueError

if TYPE_CHECKING:
    from fusion.runtime import Executor, Progress
    from fusion.workspace import Workspace


class Done(NamedTuple):
    """What a command gives: the object of ``--json``, and lines for people."""

    content: Mapping[str, Any]
    lines: Iterable[str]


@dataclass(frozen=True)
class Site:
    """The workspace of a command, and what does its work.

    Parameters
    ----------
    root : Path
        The workspace.
    executor : Executor
    progress : Progress
    solution : str
        By default the one in use.
    wait : bool
        Whether to wait while another program works with the same solution.
    folders : tuple of Path
        Files that other files name, such as kernels of a meta-kernel, must lie in one of these;
        if empty, they may lie anywhere.
    job : str
        The job of the service that asks for it; empty on the command line.
    lasting : callable
        Returns the path by which records name a file of the command, from the one where it reads
        it: files of a job are read in a folder that is removed at its end.
    """

    root: Path
    executor: Executor
    progress: Progress
    solution: str = ""
    wait: bool = False
    folders: tuple[Path, ...] = ()
    job: str = ""
    lasting: Callable[[str], str] = str

    def open(self, solution: str = "") -> Workspace:
        """Open the workspace with its solution, or another one."""
        from fusion.workspace import Workspace

        return Workspace.open(self.root, solution or self.solution)

    def check_inside(self, paths: Iterable[Path], named_in: Path) -> None:
        """Refuse files that a file names outside the folders.

        Raises
        ------
        InvalidValueError
        """
        for path in paths if self.folders else ():
            if not any(path.resolve().is_relative_to(folder) for folder in self.folders):
                raise InvalidValueError(
                    "names a file that is not an upload of the job",
                    f"{named_in.name}: {path.name}",
                    "upload it too, and name it without a folder",
                )
