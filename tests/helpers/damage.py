"""Damage to files, and commands that must then leave every file as it was."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import command_line
from command_line import called

from fusion.scaling.geometry import pair_size
from fusion.truth.presets import MissionSettings

TINY = MissionSettings.tiny()
PAIR_SIZE, _ = pair_size(TINY.body.radius, TINY.solution.gsd)
# Not results: the index and its lock, parts that a later run picks up, and the notes of runs.
ASIDE = (".lock", ".scratch", ".items", "catalog.sqlite", "provenance")
Edit = Callable[[bytes], bytes]


def files_in(root: Path) -> dict[str, str]:
    """Return the digest of every file that is a result or an input, by its relative path."""
    return {
        str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(root.rglob("*"))
        if path.is_file() and path.relative_to(root).parts[0] not in ASIDE
    }


def refused(workspace: Path, *command: str) -> str:
    """Run a command that must fail and leave every file as it was; return its line."""
    before = files_in(workspace)
    line = command_line.refused(command[0], workspace, *command[1:], "--json")
    assert "unexpected" not in line
    assert files_in(workspace) == before
    assert not list(workspace.rglob("*.part"))
    return line


def states(workspace: Path) -> dict[str, str]:
    """Run all stages, and return what became of each."""
    return {one["stage"]: one["state"] for one in called("run", workspace)["stages"]}


def damage(root: Path, name: str, edit: Edit) -> None:
    """Replace a file (or a link to one) by an edited copy of it."""
    path = root / name
    content = path.read_bytes()
    path.unlink()
    path.write_bytes(edit(content))


def swapped(old: str, new: str) -> Edit:
    """Return an edit that replaces `old`, which must be there, once."""

    def edit(content: bytes) -> bytes:
        assert old.encode() in content
        return content.replace(old.encode(), new.encode(), 1)

    return edit


def line_set(number: int, text: str) -> Edit:
    """Return an edit that puts `text` in the place of a line (from 1)."""

    def edit(content: bytes) -> bytes:
        lines = content.decode().splitlines()
        lines[number - 1] = text
        return ("\n".join(lines) + "\n").encode()

    return edit


def at(offset: int, patch: bytes) -> Edit:
    """Return an edit that writes `patch` over the bytes at `offset`."""
    return lambda content: content[:offset] + patch + content[offset + len(patch) :]


EMPTY: Edit = lambda _: b""  # noqa: E731

HALF: Edit = lambda content: content[: len(content) // 2]  # noqa: E731

RUBBISH: Edit = lambda _: b"rubbish, and more of it" * 40  # noqa: E731
