"""Files are whole or not there, and have the permissions of any new file."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from spcola import atomic
from spcola.errors import WorkspaceError


@pytest.mark.parametrize("mask", [0o022, 0o027, 0o077])
def test_a_file_has_the_permissions_of_any_new_one(tmp_path: Path, mask: int) -> None:
    before = os.umask(mask)
    try:
        atomic.write_text(tmp_path / "a", "x")
        atomic.write_text(tmp_path / "a", "y")
        (tmp_path / "plain").touch()
    finally:
        os.umask(before)
    modes = [(tmp_path / name).stat().st_mode & 0o777 for name in ("a", "plain")]
    assert modes == [0o666 & ~mask] * 2


def test_no_thread_finds_another_umask(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the process gives new files is never set, not even for a moment."""

    def forbidden(_mask: int) -> int:
        raise AssertionError("the umask of the process was set")

    monkeypatch.setattr(os, "umask", forbidden)
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda k: atomic.write_text(tmp_path / f"{k % 3}", f"{k}"), range(40)))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["0", "1", "2"]


def test_what_fails_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "a"
    atomic.write_text(path, "old")

    def half_written() -> None:
        with atomic.replacing(path) as temporary:
            temporary.write_text("half", encoding="utf-8")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        half_written()
    assert path.read_text(encoding="utf-8") == "old"
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(WorkspaceError, match="create the folder first"):
        atomic.write_text(tmp_path / "none" / "a", "x")
