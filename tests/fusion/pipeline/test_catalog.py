"""Digests of files: those of their bytes, stored as long as the files are unchanged."""

from __future__ import annotations

import hashlib
import os
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from threading import Barrier, Event

import pytest

from fusion.pipeline.catalog import Catalog, file_digest, read_record
from fusion.pipeline.catalog.records import StageRecord, record_path
from fusion.pipeline.catalog.rows import CATALOG_FILE
from fusion.runtime.machine import forget_pages
from fusion.workspace import Workspace, new_workspace
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
    forget_pages(path)
    forget_pages(tmp_path / "gone")
    assert file_digest(path) == digest == hashlib.sha256(path.read_bytes()).hexdigest()
    monkeypatch.delattr(os, "posix_fadvise", raising=False)
    forget_pages(path)
    assert file_digest(path) == digest


def test_a_file_edited_in_place_with_its_old_time_gets_a_new_digest(workspace: Workspace) -> None:
    path = workspace.root / "file"
    path.write_bytes(b"as it was")
    catalog, state = Catalog(workspace), path.stat()
    before = catalog.digest(path)
    with path.open("r+b") as stream:
        stream.write(b"as it is ")
    os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))
    assert path.stat().st_mtime_ns == state.st_mtime_ns
    assert catalog.digest(path) == hashlib.sha256(b"as it is ").hexdigest() != before
    catalog.close()


def test_a_file_rewritten_within_one_tick_of_the_clock_gets_a_new_digest(
    workspace: Workspace,
) -> None:
    path = workspace.root / "file"
    catalog = Catalog(workspace)
    for number in range(60):
        path.write_bytes(f"{2 * number:04d}".encode())
        catalog.digest(path)
        text = f"{2 * number + 1:04d}".encode()
        path.write_bytes(text)
        assert catalog.digest(path) == hashlib.sha256(text).hexdigest()
    catalog.close()


def record_of(workspace: Workspace) -> StageRecord:
    digest = Catalog(workspace).digest(workspace.root / "spcola.toml")
    return StageRecord(
        "fuse", "k", "1", {"T": {"a": 1.5}}, {"in": digest}, {"out": digest}, {"n": 0.999}, "now"
    )


def test_a_wrong_digest_in_the_catalogue_is_not_used(workspace: Workspace) -> None:
    path = workspace.root / "spcola.toml"
    catalog = Catalog(workspace)
    right = catalog.digest(path)
    catalog._base.execute("UPDATE file SET digest = ?", ("0" * 64,))
    catalog._base.commit()
    catalog.close()
    again = Catalog(workspace)
    assert again.digest(path) == right
    again.close()


@pytest.mark.parametrize("content", ["{", '{"stage": "fuse"}', "[]", '{"stage": 1e999}', "null"])
def test_a_damaged_copy_of_a_record_counts_as_none(workspace: Workspace, content: str) -> None:
    catalog = Catalog(workspace)
    catalog.store(record_of(workspace))
    catalog._base.execute("UPDATE stage SET record = ?", (content,))
    catalog._base.commit()
    assert catalog.record("fuse") == record_of(workspace)
    record_path(workspace, "fuse").unlink()
    assert catalog.record("fuse") is None
    catalog.close()


def test_a_damaged_record_is_restored_from_its_copy_and_that_is_noted(
    workspace: Workspace,
) -> None:
    catalog, path = Catalog(workspace), record_path(workspace, "fuse")
    catalog.store(record_of(workspace))
    whole = path.read_bytes()
    path.write_bytes(whole.replace(b"0.999", b"0.998"))
    assert read_record(workspace, "fuse") is None
    catalog.restore()
    assert path.read_bytes() == whole
    assert "was damaged; restored from catalog.sqlite" in catalog.notes[0]
    catalog.close()


def test_every_flipped_byte_of_the_catalogue_leaves_the_records_as_they_are(
    workspace: Workspace,
) -> None:
    catalog = Catalog(workspace)
    catalog.store(record_of(workspace))
    digest = catalog.digest(workspace.root / "spcola.toml")
    catalog.close()
    path = workspace.root / CATALOG_FILE
    whole = path.read_bytes()
    for place in [*range(100), *range(100, len(whole), len(whole) // 100)]:
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0x10]) + whole[place + 1 :])
        damaged = Catalog(workspace)
        damaged.restore()
        assert damaged.record("fuse") == record_of(workspace), place
        assert damaged.digest(workspace.root / "spcola.toml") == digest, place
        damaged.close()


def test_a_damaged_name_of_a_column_is_mended(workspace: Workspace) -> None:
    catalog = Catalog(workspace)
    catalog.store(record_of(workspace))
    catalog.close()
    path = workspace.root / CATALOG_FILE
    whole = path.read_bytes()
    assert whole.count(b"digest TEXT") > 0
    path.write_bytes(whole.replace(b"digest TEXT", b"d\xccgest TEXT"))
    mended = Catalog(workspace)
    assert mended.record("fuse") == record_of(workspace)
    assert "was damaged; made again" in mended.notes[0]
    mended.close()


def test_programs_that_open_a_new_catalogue_at_once_share_it(tmp_path: Path) -> None:
    """One that a reader finds half made would be taken for damaged, and replaced."""
    for number in range(25):
        workspace, start = new_workspace(tmp_path / str(number)), Barrier(4)

        def opened(workspace: Workspace = workspace, start: Barrier = start) -> str:
            start.wait()
            with closing(Catalog(workspace, read_only=True)) as catalog:
                return catalog.digest(workspace.root / "spcola.toml") + "".join(catalog.notes)

        with ThreadPoolExecutor(4) as pool:
            found = [one.result() for one in [pool.submit(opened) for _ in range(4)]]
        assert len(set(found)) == 1
        assert not list(workspace.root.glob(".*.part"))
