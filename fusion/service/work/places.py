"""Where workspaces and uploads lie in the folder of the service."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fusion.runtime.folders import make_folder
from fusion.service.commands.fields import Mark
from fusion.service.commands.json_options import Output
from fusion.service.state import STATE_FOLDER, outputs_folder, uploads_folder, workspace_place
from fusion.service.store import StoreError, StoreFault, Upload
from fusion.service.texts import with_texts, without_paths, without_paths_in
from spcola.errors import InvalidValueError, WorkspaceError

__all__ = ["Desk", "Places", "output_files", "remove_output", "two_of_one_name"]


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
        root = workspace_place(self.folder, name)
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
        return [self.upload_file(workspace, identity) for identity in identities]

    def one_upload(self, workspace: str, identity: str | None) -> Path | None:
        """Return the file of an upload; None if none is named."""
        return None if identity is None else self.upload_file(workspace, identity)

    def upload_file(self, workspace: str, identity: str) -> Path:
        """Return the file of an upload; raises as :meth:`uploads`."""
        none = InvalidValueError(
            "is no complete upload to this workspace", f"upload {identity[:64]!r}"
        )
        try:
            record = self.upload(identity)
        except StoreError as error:
            if error.code is StoreFault.UNKNOWN_UPLOAD:
                raise none from error
            raise
        path = uploads_folder(self.folder) / record.id / "file" / Path(record.name).name
        if record.workspace != workspace or path.resolve() != path or not path.is_file():
            raise none
        return path

    def output(self, workspace: str, name: str) -> Path:
        """Return what an earlier job has written for its user.

        Raises
        ------
        InvalidValueError
            If there is no such file, or a link leads to it.
        """
        path = self._outputs(workspace) / name
        if path.resolve() != path or not path.is_file():
            raise InvalidValueError("is no output of an earlier job", f"output {name[:64]!r}")
        return path

    @contextmanager
    def desk(self, workspace: str, job: str, *, together: bool = True) -> Iterator[Desk]:
        """Yield folders for the files of a job; what it has written is an output then.

        Its files are linked into one folder if they have to lie `together`. An earlier output of
        the same name is replaced. What a job wrote that fails is removed.
        """
        desk = Desk(
            self,
            workspace,
            self._gathered / job,
            self._outputs(workspace) / f".{job}",
            together,
        )
        try:
            # A worker that was lost may have left some.
            desk.clear()
            yield desk
            desk.keep()
        finally:
            desk.clear()

    @property
    def _gathered(self) -> Path:
        return self.folder / STATE_FOLDER / "gathered"

    def _outputs(self, workspace: str) -> Path:
        return outputs_folder(self.folder, workspace)

    def without_folder(self, text: str) -> str:
        """Return a text in which files are named from the folder of the service on.

        An upload has the name that its user gave it.
        """
        return without_paths(self.without_uploads(text), self.folder)

    def without_uploads(self, text: str) -> str:
        """Return a text in which uploads have the names that their users gave them."""
        uploads, gathered = (
            re.escape(str(one)) for one in (uploads_folder(self.folder), self._gathered)
        )
        return re.sub(rf"(?:{uploads}/[\w-]+/file|{gathered}/[\w-]+)/", "", text)

    def without_folder_in(self, value: Any) -> Any:
        """Return a value in JSON types whose texts are as of :meth:`without_folder`."""
        return without_paths_in(value, self.folder)


def two_of_one_name(name: str) -> InvalidValueError:
    """Return the error of two different files of one name: they cannot lie in one folder."""
    what = "is the name of two files of the job"
    return InvalidValueError(what, name, "upload one under another name")


def output_files(folder: Path, workspace: str) -> dict[str, int]:
    """Return the files that jobs in a workspace have written for their users, with their sizes."""
    root = outputs_folder(folder, workspace)
    found = (path for path in root.rglob("*") if path.is_file() and not path.is_symlink())
    names = ((path.relative_to(root), path) for path in found)
    return {
        name.as_posix(): path.stat().st_size
        for name, path in names
        if not name.parts[0].startswith(".")
    }


def remove_output(folder: Path, workspace: str, name: str) -> bool:
    """Remove what a job has written for its user; return whether it was there.

    Parameters
    ----------
    folder : Path
        That of the service.
    workspace : str
    name : str
        Of a file, or of a folder, which goes with all that is in it.
    """
    path = outputs_folder(folder, workspace) / name
    if len(Path(name).parts) != 1 or name.startswith("."):
        return False
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    elif path.exists():
        path.unlink()
    else:
        return False
    return True


@dataclass(frozen=True)
class Desk:
    """The files of one job: those that it reads together in one folder, and those that it writes.

    Labels find pixels, meta-kernels kernels, and images their states by names in one folder.

    Parameters
    ----------
    places : Places
    workspace : str
    read, written : Path
        Folders of this job alone.
    together : bool
        Whether the files are linked into `read`.
    sources : dict
        The files that are linked there, by their paths in `read`.
    """

    places: Places
    workspace: str
    read: Path
    written: Path
    together: bool = True
    sources: dict[str, Path] = field(default_factory=dict)

    def path_of(self, given: Any, mark: Mark | None) -> Path:
        """Return the path of a file, a folder of files, or an output, as parameters name them.

        Raises
        ------
        InvalidValueError
            If there is no such upload or output, or two of one name.
        """
        if mark is Mark.OUTPUT:
            make_folder(self.written)
            return self.written / str(given)
        if mark is Mark.FOLDER:
            for one in given:
                self.path_of(one, None)
            return self.read
        if isinstance(given, Output):
            source = self.places.output(self.workspace, given.output)
        else:
            source = self.places.upload_file(self.workspace, given)
        if not self.together:
            return source
        make_folder(self.read)
        target = self.read / source.name
        if not target.exists():
            target.hardlink_to(source)
        elif not target.samefile(source):
            raise two_of_one_name(source.name)
        self.sources[str(target)] = source
        return target

    def lasting(self, path: str) -> str:
        """Return where a file of the job remains when the folders of the job are gone."""
        return str(self.sources.get(path, path))

    def keep(self) -> None:
        """Make what was written outputs of the workspace."""
        for path in sorted(self.written.iterdir()) if self.written.is_dir() else ():
            target = self.written.parent / path.name
            if target.is_dir() and not target.is_symlink():
                shutil.rmtree(target)
            path.replace(target)

    def clear(self) -> None:
        """Remove both folders."""
        for folder in (self.read, self.written):
            shutil.rmtree(folder, ignore_errors=True)

    def named(self, text: str) -> str:
        """Return a text in which the files of the job have the names that users know."""
        text = text.replace(f"{self.written}/", "outputs/").replace(f"{self.read}/", "")
        return self.places.without_uploads(text)

    def named_in(self, value: Any) -> Any:
        """Return a value in JSON types whose texts are as of :meth:`named`."""
        return with_texts(value, self.named)
