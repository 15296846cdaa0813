"""The folder that is served: which workspaces it has, and where they lie."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from fusion.service.api.errors import Refusal, RequestRefusedError
from fusion.workspace import SETTINGS_FILE, Workspace
from spcola.errors import WorkspaceError

__all__ = ["NAME", "STATE_FOLDER", "ServedFolder"]

NAME = r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}"
"""What the name of a workspace looks like."""
STATE_FOLDER = ".service"


@dataclass
class ServedFolder:
    """A folder of workspaces.

    Parameters
    ----------
    root : Path
        A workspace, or a folder whose sub-folders are workspaces.
    """

    root: Path

    def __post_init__(self) -> None:
        self.root = self.root.resolve()

    @property
    def uploads(self) -> Path:
        """The folder of uploads."""
        return self.root / STATE_FOLDER / "uploads"

    @property
    def is_single(self) -> bool:
        """Whether the folder itself is the only workspace."""
        return (self.root / SETTINGS_FILE).is_file()

    def names(self) -> list[str]:
        """Return the names of all workspaces, sorted."""
        if self.is_single:
            return [self.root.name]
        folders = (path.parent for path in self.root.glob(f"*/{SETTINGS_FILE}"))
        return sorted(path.name for path in folders if re.fullmatch(NAME, path.name))

    def folder(self, name: str) -> Path:
        """Return the folder of a workspace.

        Raises
        ------
        RequestRefusedError
            If there is none of this name.
        """
        if self.is_single:
            folder = self.root if name == self.root.name else None
        else:
            folder = self.root / name if re.fullmatch(NAME, name) else None
        if folder is None or not (folder / SETTINGS_FILE).is_file():
            raise RequestRefusedError(Refusal.NOT_FOUND, "there is no such workspace", name)
        return folder

    def place(self, name: str) -> Path:
        """Return where a workspace lies or may be made; raises RequestRefusedError if nowhere."""
        if self.is_single or not re.fullmatch(NAME, name):
            return self.folder(name)
        return self.root / name

    def workspace(self, name: str, solution: str = "") -> Workspace:
        """Open a workspace; raises RequestRefusedError if there is none of this name."""
        return Workspace.open(self.folder(name), solution)

    @contextmanager
    def opened(self, name: str, solution: str = "") -> Iterator[Workspace]:
        """Open a workspace to read from it.

        Raises
        ------
        RequestRefusedError
            If there is no such workspace or solution, or no such thing in it.
        """
        try:
            yield self.workspace(name, solution)
        except WorkspaceError as error:
            if error.__cause__ is not None:
                raise
            raise RequestRefusedError(
                Refusal.NOT_FOUND, error.what, error.where, error.do
            ) from error
