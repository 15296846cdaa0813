"""The folder of a mission while it is made: finished files survive an interruption."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import spcola
from fusion.runtime.folders import clear_leftovers, locked, make_folder
from fusion.truth.blind.settings import BLIND_PARTS, BlindSettings
from fusion.truth.planted import TRUTH_FILE, Planted, read_truth
from fusion.truth.presets import MissionSettings
from fusion.workspace import SPC_FOLDERS
from spcola.atomic import write_error, write_text
from spcola.errors import SpcolaError, WorkspaceError

SPC_FOLDER, LIDAR_FOLDER, IMAGE_FOLDER = "spc", "lidar", "images"
MAKING_FOLDER = ".making"
_SPC_PARTS = (SPC_FOLDER, LIDAR_FOLDER, IMAGE_FOLDER)
_PARTS = (*_SPC_PARTS, *BLIND_PARTS[2:])
_STAMP = "mission.json"


@dataclass(frozen=True)
class Site:
    """Folder in which a mission is being made.

    Every file is written whole or not at all, and none depends on the order of work: an existing
    file is finished, and an interrupted run resumes after it. Values that later files need with
    more digits than earlier files have are kept in notes.

    Attributes
    ----------
    root : Path
    """

    root: Path

    @property
    def spc(self) -> Path:
        """The SPC working folder."""
        return self.root / SPC_FOLDER

    @property
    def lidar(self) -> Path:
        """The folder of the scans."""
        return self.root / LIDAR_FOLDER

    @property
    def images(self) -> Path:
        """The folder of the images in other formats than SPC's."""
        return self.root / IMAGE_FOLDER

    def note(self, name: str) -> Any:
        """Return the content noted under `name` by :meth:`keep`; None if there is none."""
        path = self._note_path(name)
        return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None

    def keep(self, name: str, content: Any) -> None:
        """Note `content`, with all digits of numbers; an item with a note is finished."""
        write_text(self._note_path(name), json.dumps(content))

    def _note_path(self, name: str) -> Path:
        return self.root / MAKING_FOLDER / f"{name}.json"


@contextmanager
def building(
    root: Path, settings: MissionSettings, fingerprint: str, *, replace: bool
) -> Iterator[Site]:
    """Open the folder of a mission to make it, or to resume making it.

    Parameters
    ----------
    root : Path
        Created if missing.
    settings : MissionSettings
    fingerprint : str
        Of the body. Files of a mission of the same settings, body and version are kept.
    replace : bool
        Whether a mission of other settings may be removed.

    Raises
    ------
    WorkspaceError
        If `root` holds other things, or another mission that may not be removed; if another
        program works in it, or it cannot be written.
    """
    making = root / MAKING_FOLDER
    kind = {"digest": settings.digest, "body": fingerprint, "version": spcola.__version__}
    stamp = json.dumps(kind)
    folders = [root / part for part in _folders(settings)]
    ours = _is_of(root, settings, fingerprint, stamp)
    strange = bool(_names(root) - {MAKING_FOLDER}) and not ours
    if strange and not replace:
        raise WorkspaceError(
            "holds another mission, or a part of one", root, "choose another folder, or remove it"
        )
    make_folder(making)
    with locked(making / "lock"):
        if strange:
            _clear(root)
        write_text(making / _STAMP, stamp)
        (root / TRUTH_FILE).unlink(missing_ok=True)
        for folder in folders:
            make_folder(folder)
        clear_leftovers([root, making, *folders])
        yield Site(root)
        shutil.rmtree(making)


def _folders(settings: MissionSettings) -> list[str]:
    """Return the folders of a mission."""
    if isinstance(settings, BlindSettings):
        return list(BLIND_PARTS)
    return [*_SPC_PARTS, *(f"{SPC_FOLDER}/{name}" for name in SPC_FOLDERS)]


def finished(root: Path, settings: MissionSettings, fingerprint: str) -> Planted | None:
    """Return what is planted in this mission if it exists and is complete; else None."""
    planted = _planted(root)
    if planted is None or not planted.is_of(settings, fingerprint):
        return None
    whole = planted.files.items() <= files_of(root).items()
    return planted if whole else None


def files_of(root: Path) -> dict[str, int]:
    """Return the size in bytes of every file of a mission, by its path, without ``truth.json``."""
    paths = [path for part in _PARTS for path in sorted((root / part).rglob("*"))]
    return {
        path.relative_to(root).as_posix(): path.stat().st_size for path in paths if path.is_file()
    }


def _names(root: Path) -> set[str]:
    """Return the names in the folder, refused unless they are those of a mission."""
    try:
        there = {entry.name for entry in root.iterdir()} if root.exists() else set()
    except OSError as error:
        raise WorkspaceError(f"cannot be listed ({error.strerror})", root) from error
    # Folders of these names may be other data: only those of a mission are removed.
    ours = {TRUTH_FILE, MAKING_FOLDER}
    if there - {*_PARTS, *ours} or (there and not there & ours):
        raise WorkspaceError(
            "holds other things than a synthetic mission", root, "choose an empty folder"
        )
    return there


def _is_of(root: Path, settings: MissionSettings, fingerprint: str, stamp: str) -> bool:
    """Return whether the files were made of these settings and body, complete or not."""
    path = root / MAKING_FOLDER / _STAMP
    if path.is_file():
        return path.read_text(encoding="utf-8") == stamp
    planted = _planted(root)
    return planted is not None and planted.is_of(settings, fingerprint)


def _planted(root: Path) -> Planted | None:
    """Return what is planted in the mission; None if it cannot be read."""
    try:
        return read_truth(root)
    except SpcolaError:
        return None


def _clear(root: Path) -> None:
    """Remove a mission."""
    try:
        (root / TRUTH_FILE).unlink(missing_ok=True)
        for part in _PARTS:
            if (root / part).exists():
                shutil.rmtree(root / part)
        for note in (root / MAKING_FOLDER).glob("*.json"):
            note.unlink()
    except OSError as error:
        raise write_error(root, error) from error
