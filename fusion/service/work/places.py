"""Where workspaces and uploads lie in the folder of the service."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fusion.service.store import Upload
from fusion.workspace import SETTINGS_FILE
from spcola.errors import InvalidValueError, WorkspaceError

STATE_FOLDER = ".service"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")


@dataclass(frozen=True)
class Places:
    """The folder of the service, and what lies in it.

    Parameters
    ----------
    folder : Path
        Resolved; a workspace, or a folder whose sub-folders are workspaces.
    upload : callable
        Returns the record of an upload by its id.
    """

    folder: Path
    upload: Callable[[str], Upload]

    def workspace(self, name: str) -> Path:
        """Return where a workspace lies, or is to be made.

        Raises
        ------
        WorkspaceError
            If it would lie anywhere else than in the folder of the service.
        """
        if (self.folder / SETTINGS_FILE).is_file():
            root = self.folder if name == self.folder.name else None
        else:
            root = self.folder / name if _NAME.fullmatch(name) else None
        if root is None or root.resolve() != root:
            raise WorkspaceError("there is no such workspace in the service", repr(name[:80]))
        return root

    def uploads(self, workspace: str, identities: Iterable[str]) -> list[Path]:
        """Return the files of complete uploads to a workspace.

        Raises
        ------
        InvalidValueError
            If one is not of this workspace, or not complete.
        """
        return [self._file(workspace, identity) for identity in identities]

    def one_upload(self, workspace: str, identity: str | None) -> Path | None:
        """Return the file of an upload; None if none is named."""
        return None if identity is None else self._file(workspace, identity)

    def _file(self, workspace: str, identity: str) -> Path:
        record = self.upload(identity)
        path = self.folder / STATE_FOLDER / "uploads" / record.id / "file" / Path(record.name).name
        if record.workspace != workspace or path.resolve() != path or not path.is_file():
            raise InvalidValueError(
                "is no complete upload to this workspace", f"upload {identity[:64]!r}"
            )
        return path

    def without_folder(self, text: str) -> str:
        """Return a text in which files are named from the folder of the service on."""
        return text.replace(f"{self.folder}/", "").replace(str(self.folder), self.folder.name)

    def without_folder_in(self, value: Any) -> Any:
        """Return a value in JSON types whose texts are as of :meth:`without_folder`."""
        if isinstance(value, Mapping):
            return {key: self.without_folder_in(part) for key, part in value.items()}
        if isinstance(value, list | tuple):
            return [self.without_folder_in(part) for part in value]
        return self.without_folder(str(value)) if isinstance(value, str | Path) else value
