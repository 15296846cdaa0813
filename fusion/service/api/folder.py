"""The folder that is served: which workspaces it has, and where they lie."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from fusion.service.api.errors import Refusal, RequestRefusedError
from fusion.service.state import WORKSPACE_NAME, uploads_folder, workspace_place
from fusion.workspace import SETTINGS_FILE, Workspace
from spcola.errors import WorkspaceError

__all__ = ["ServedFolder"]


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
        return uploads_folder(self.root)

    @property
    def is_single(self) -> bool:
        """Whether the folder itself is the only workspace."""
        return (self.root / SETTINGS_FILE).is_file()

    def names(self) -> list[str]:
        """Return the names of all workspaces, sorted."""
        if self.is_single:
            return [self.root.name]
        folders = (path.parent for path in self.root.glob(f"*/{SETTINGS_FILE}"))
        return sorted(path.name for path in folders if re.fullmatch(WORKSPACE_NAME, path.name))

    def folder(self, name: str) -> Path:
        """Return the folder of a workspace.

        Raises
        ------
        RequestRefusedError
            If there is none of this name.
        """
        folder = workspace_place(self.root, name)
        if folder is None or not (folder / SETTINGS_FILE).is_file():
            raise RequestRefusedError(Refusal.NOT_FOUND, "there is no such workspace", name)
        return folder

    def place(self, name: str) -> Path:
        """Return where a workspace lies or may be made; raises RequestRefusedError if nowhere."""
        return workspace_place(self.root, name) or self.folder(name)

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
