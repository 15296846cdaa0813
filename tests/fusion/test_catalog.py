"""Digests of files: those of their bytes, kept as long as the files stay as they are."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from threading import Event

import pytest

from fusion.catalog import Catalog
from fusion.digests import file_digest
from fusion.initialise import new_workspace
from fusion.pages import release
from fusion.workspace import Workspace
from spcola.errors import WorkspaceError


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    new_workspace(tmp_path / "ws", body="Bennu")
    return Workspace.open(tmp_path / "ws")


def test_digests_of_many_files_are_those_of_their_bytes(workspace: Workspace) -> None:
    paths = [workspace.root / f"file{number}" for number in range(6)]
    for number, path in enumerate(paths):
        path.write_bytes(bytes([number]) * (number * 700_000))
    expected = [hashlib.sha256(path.read_bytes()).hexdigest() for path in paths]
    catalog = Catalog(workspace)
    assert catalog.digests_of(paths) == expected
    paths[2].write_bytes(b"other")
    expected[2] = hashlib.sha256(b"other").hexdigest()
    assert catalog.digests_of(paths[::-1]) == expected[::-1]
    assert catalog.digests(paths)["file2"] == expected[2]
    catalog.close()


def test_a_missing_file_among_many_is_named(workspace: Workspace) -> None:
    there = workspace.root / "there"
    there.write_bytes(b"x")
    catalog = Catalog(workspace)
    with pytest.raises(WorkspaceError, match="gone"):
        catalog.digests_of([there, workspace.root / "gone"])
    catalog.close()


def test_a_digest_ends_when_it_is_stopped(tmp_path: Path) -> None:
    path, stopped = tmp_path / "file", Event()
    path.write_bytes(b"x" * 3_000_000)
    stopped.set()
    assert file_digest(path, stopped) != file_digest(path)


def test_digests_are_kept_as_far_as_they_were_taken(workspace: Workspace) -> None:
    paths = [workspace.root / f"file{number}" for number in range(40)]
    for number, path in enumerate(paths):
        path.write_bytes(bytes([number]))
    catalog = Catalog(workspace)
    with catalog.digesting(paths) as digests:
        first = [next(digests) for _ in range(5)]
    catalog.close()
    again = Catalog(workspace)
    assert first == [hashlib.sha256(path.read_bytes()).hexdigest() for path in paths[:5]]
    known = again._base.execute("SELECT path FROM file ORDER BY path").fetchall()
    assert [name for (name,) in known] == [f"file{number}" for number in range(5)]
    again.close()


def test_what_is_no_file_is_refused_before_any_is_read(workspace: Workspace) -> None:
    catalog = Catalog(workspace)
    for name in ("gone", "scans"):
        with (
            pytest.raises(WorkspaceError, match=name),
            catalog.digesting([workspace.root / "spcola.toml", workspace.root / name]),
        ):
            pytest.fail("nothing is begun")
    catalog.close()


def test_files_are_read_alike_where_the_system_takes_no_hints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "file"
    path.write_bytes(bytes(range(256)) * 10_000)
    digest = file_digest(path)
    release(path)
    release(tmp_path / "gone")
    assert file_digest(path) == digest == hashlib.sha256(path.read_bytes()).hexdigest()
    monkeypatch.delattr(os, "posix_fadvise", raising=False)
    release(path)
    assert file_digest(path) == digest
