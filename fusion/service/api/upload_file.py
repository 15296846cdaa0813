"""Files that arrive in parts: bytes on the disk, never looked into."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
from dataclasses import dataclass
from pathlib import Path

from fusion.runtime.folders import make_folder
from fusion.service.api.errors import Refusal, RequestRefusedError

__all__ = ["UploadFile", "clean_name", "write_whole"]

_ODD = re.compile(r"[^A-Za-z0-9._+-]+")
_LONGEST = 128


def clean_name(name: str) -> str:
    """Return a name that is safe in every folder: of letters, digits, dots, underscores, + and -.

    Raises
    ------
    RequestRefusedError
        If nothing is left of it.
    """
    cleaned = _ODD.sub("_", name.replace("\\", "/").rpartition("/")[2]).lstrip("._-")
    if not cleaned:
        raise RequestRefusedError(
            Refusal.INVALID, "has no letter or digit that a file could be called", "name"
        )
    stem, dot, suffix = cleaned.rpartition(".")
    return cleaned if len(cleaned) <= _LONGEST else f"{stem[: _LONGEST - 16]}{dot}{suffix[:15]}"


@dataclass(frozen=True)
class UploadFile:
    """One upload: a folder with the part that has arrived, or with the finished file.

    Parameters
    ----------
    folder : Path
        Of this upload alone.
    name : str
        Cleaned name of the finished file.
    """

    folder: Path
    name: str

    @property
    def path(self) -> Path:
        """Where the finished file lies."""
        return self.folder / "file" / self.name

    @property
    def part(self) -> Path:
        """Where the bytes lie that have arrived."""
        return self.folder / "part"

    def begin(self) -> None:
        """Make the folder and an empty part."""
        make_folder(self.path.parent)
        self.part.touch()
        for folder in (self.folder, self.folder.parent, self.folder.parent.parent):
            _sync(folder)

    def open_at(self, offset: int) -> int:
        """Open the part for more bytes at `offset`; those beyond, which nobody noted, are cut."""
        part = os.open(self.part, os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW, 0o600)
        os.ftruncate(part, offset)
        os.lseek(part, offset, os.SEEK_SET)
        return part

    def complete(self, sha256: str) -> None:
        """Check the checksum, and give the file its name; the same again changes nothing.

        Raises
        ------
        RequestRefusedError
            If the checksum is another.
        """
        if self.path.is_file():
            return
        with self.part.open("rb") as file:
            os.fsync(file.fileno())
            found = hashlib.file_digest(file, "sha256").hexdigest()
        if found != sha256:
            raise RequestRefusedError(
                Refusal.WRONG_CHECKSUM,
                f"the SHA-256 of what has arrived is {found}",
                "sha256",
                "the upload is removed: begin a new one",
            )
        self.part.rename(self.path)
        _sync(self.path.parent)

    def remove(self) -> None:
        """Remove all of it."""
        shutil.rmtree(self.folder, ignore_errors=True)


def write_whole(part: int, content: bytes) -> None:
    """Write all of `content` to an open file."""
    view = memoryview(content)
    while view:
        view = view[os.write(part, view) :]


def _sync(folder: Path) -> None:
    """Put a folder's entries on the disk, so that a power cut does not undo a renaming."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
