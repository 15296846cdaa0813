"""Damaged results of the program's own are named, and made again."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import sys
from pathlib import Path

import pytest
from command_line import ROOT, call, called
from damage import (
    EMPTY,
    HALF,
    RUBBISH,
    Edit,
    at,
    damage,
    files_in,
    refused,
    states,
    swapped,
)

MAP = "MAPFILES/TR0003.MAP"


OWN_FILES = {
    "mapolas.h5": ("mapolas/mapolas.h5", RUBBISH, "register", "mapolas"),
    "a mapola's map": ("mapolas/TR0003.MAP", HALF, "register", "mapolas"),
    "registration.json": ("registration.json", HALF, "fuse", "register"),
    "registration.json, a list": ("registration.json", lambda _: b"[]", "fuse", "register"),
    "registration.json, no keys": ("registration.json", lambda _: b"{}", "fuse", "register"),
    "registration.json, a key gone": (
        "registration.json",
        swapped('"per_mapola"', '"per_maple"'),
        "fuse",
        "register",
    ),
    "registration.json, a word for a number": (
        "registration.json",
        swapped('"scan_shift_m": ', '"scan_shift_m": "x", "was": '),
        "fuse",
        "register",
    ),
    "adjustment.h5": ("mapolas/adjustment.h5", HALF, "register", "mapolas"),
    "fused.h5": ("fused/fused.h5", HALF, "release", "fuse"),
    "a bigmap": ("bigmaps/NPOLE.MAP", HALF, "release", "bigmap"),
}


@pytest.mark.parametrize("case", OWN_FILES)
def test_a_damaged_result_is_named_by_the_next_stage_and_mended_by_a_run(
    workspace: Path, finished: Path, case: str
) -> None:
    name, edit, reader, maker = OWN_FILES[case]
    damage(workspace, name, edit)
    assert Path(name).name in refused(workspace, reader)
    if "registration.json, " in case:
        return  # mended as the first of them is
    assert states(workspace)[maker] == "ran"
    if not name.endswith((".h5", ".json")):  # those carry times, or the workspace's path
        assert (workspace / name).read_bytes() == (finished / name).read_bytes()
    assert set(states(workspace).values()) == {"up to date"}


@pytest.mark.parametrize(
    ("name", "maker"),
    [
        ("mapolas/TR0003.MAP", "mapolas"),
        ("fused", "fuse"),
        ("pairs", "scale"),
        ("release", "release"),
        ("report.html", "report"),
    ],
)
def test_a_result_deleted_by_hand_is_made_again(workspace: Path, name: str, maker: str) -> None:
    before = set(files_in(workspace))
    target = workspace / name
    if target.is_dir():
        shutil.rmtree(target)
    else:
        target.unlink()
    assert states(workspace)[maker] == "ran"
    assert set(files_in(workspace)) == before


@pytest.mark.parametrize("edit", [RUBBISH, HALF, EMPTY, at(8192, bytes(4096))])
def test_a_damaged_catalogue_costs_nothing_but_a_look_at_the_files(
    workspace: Path, edit: Edit
) -> None:
    before = files_in(workspace)
    damage(workspace, "catalog.sqlite", edit)
    assert set(states(workspace).values()) == {"up to date"}
    assert files_in(workspace) == before


SCAN = "scans/scan03.h5"


SCAN_DAMAGES: dict[str, Edit] = {
    "cut": HALF,
    "empty": EMPTY,
    "rubbish": RUBBISH,
    "garbled inside": lambda c: at(len(c) // 2, bytes(4000))(c),
}


@pytest.mark.parametrize("case", SCAN_DAMAGES)
def test_a_damaged_scan_is_read_again_from_its_file(workspace: Path, case: str) -> None:
    before = files_in(workspace)
    damage(workspace, SCAN, SCAN_DAMAGES[case])
    assert SCAN in refused(workspace, "mapolas")
    problems = called("info", workspace)["problems"]
    assert case == "garbled inside" or [SCAN in text for text in problems] == [True]
    content = called("run", workspace)
    (note,) = [text for text in content["stages"][0]["notes"] if "read again" in text]
    assert "scan03 was damaged" in note
    assert files_in(workspace) == before


@pytest.fixture
def imported(mission: Path, tmp_path: Path) -> tuple[Path, Path]:
    """A workspace with one scan, and the file of that, which may be changed."""
    source = shutil.copy2(mission / "lidar" / "scan03.dat", tmp_path)
    call("init", tmp_path / "ws", "--spc", mission / "spc")
    call("import", tmp_path / "ws", source)
    return tmp_path / "ws", Path(source)


def test_a_damaged_scan_whose_file_is_gone_is_refused(imported: tuple[Path, Path]) -> None:
    workspace, source = imported
    damage(workspace, SCAN, HALF)
    source.unlink()
    assert "is gone; restore one of them" in refused(workspace, "run")


def test_scans_that_are_gone_are_named(workspace: Path) -> None:
    (workspace / SCAN).unlink()
    assert f"{SCAN}, which stage ingest wrote, is gone" in refused(workspace, "run")
    shutil.rmtree(workspace / "scans")
    line = refused(workspace, "run")
    assert "scans/scan01.h5, scans/scan02.h5, scans/scan03.h5 and 5 more" in line


def test_a_scan_under_two_names_is_refused_by_what_would_count_it_twice(workspace: Path) -> None:
    shutil.copy(workspace / SCAN, workspace / "scans" / "again.h5")
    for command in ("run", "scale", "mapolas", "bigmap"):
        line = refused(workspace, command)
        assert "scan03.h5" in line
        assert "again.h5" in line
    assert "hold the same scan" in call("info", workspace).stdout
    assert called("fuse", workspace)["state"] == "up to date"


def test_a_lidar_file_that_lost_returns_is_not_read_again_in_silence(
    imported: tuple[Path, Path],
) -> None:
    """Cut at the end of a record, and with the time of writing that it had."""
    workspace, source = imported
    whole, state = source.read_bytes(), source.stat()
    source.write_bytes(whole[: 186 * 400])
    os.utime(source, ns=(state.st_atime_ns, state.st_mtime_ns))
    line = refused(workspace, "run")
    assert "has changed since it was imported as scan03" in line
    assert "spcola import" in line
    again = called("import", workspace, source)["scans"][0]
    assert again["state"] == "imported again"
    assert again["returns"] < again["returns_before"]


@pytest.mark.parametrize(
    ("byte", "words"),
    [(15, "V lies"), (30, "an axis"), (9, "the GSD"), (63, "its heights"), (67, "sigma of V")],
)
def test_a_maplet_that_its_landmark_or_the_shape_contradicts_is_refused_by_all(
    workspace: Path, byte: int, words: str
) -> None:
    damage(workspace, MAP, lambda c: at(byte, bytes([c[byte] ^ 1]))(c))
    content = call("run", workspace, "--json", code=1)
    assert f"{MAP}: {words}" in content.stderr
    stages = {one["stage"]: one["state"] for one in json.loads(content.stdout)["stages"]}
    assert set(stages.values()) == {"up to date", "cannot run"}
    assert f"{MAP}: {words}" in refused(workspace, "scale")
    problems = called("info", workspace)["problems"]
    assert [MAP in text for text in problems] == [True]


@pytest.mark.slow
def test_a_maplet_that_is_left_out_is_left_out_by_all(workspace: Path) -> None:
    damage(workspace, MAP, lambda c: at(16, bytes([c[16] ^ 1]))(c))
    command = ("run", workspace, "--json", "--accept", "unsound-maplet")
    stages = json.loads(call(*command).stdout)["stages"]
    assert not (workspace / "mapolas" / "TR0003.MAP").exists()
    assert not (workspace / "fused" / "TR0003.MAP").exists()
    for one in stages:
        if one["stage"] in ("mapolas", "register", "fuse", "scale"):
            texts = [found["text"] for found in one["summary"]["findings"]]
            assert any(f"{MAP} was left out" in text for text in texts), one["stage"]
    again = json.loads(call(*command).stdout)["stages"]
    assert {one["state"] for one in again} == {"up to date"}


def test_a_result_that_was_changed_is_used_on_demand_and_that_is_recorded(
    workspace: Path,
) -> None:
    damage(workspace, "mapolas/adjustment.h5", lambda c: at(900, bytes([c[900] ^ 1]))(c))
    line = refused(workspace, "register")
    assert "mapolas/adjustment.h5 has changed since stage mapolas wrote it" in line
    assert f"run: spcola mapolas {workspace} again, or --accept changed-input" in line
    damage(workspace, "registration.json", swapped('"converged": ', '"converged":  '))
    assert "mapolas/adjustment.h5" in refused(workspace, "fuse")
    done = call("fuse", workspace, "--json", "--accept", "changed-input")
    texts = [one["text"] for one in json.loads(done.stdout)["summary"]["findings"]]
    assert any("registration.json has changed" in text for text in texts)
    record = json.loads((workspace / "provenance" / "fuse.json").read_text())
    assert {one["code"] for one in record["summary"]["findings"]} == {"changed-input"}


def test_a_flipped_bit_in_a_result_is_healed_refused_or_without_effect(
    finished: Path, tmp_path: Path
) -> None:
    """One in each kind of file; ``scripts/bench/flips.py`` makes a thousand."""
    spec = importlib.util.spec_from_file_location("flips", ROOT / "scripts" / "bench" / "flips.py")
    assert spec is not None
    assert spec.loader is not None
    flips = importlib.util.module_from_spec(spec)
    sys.modules["flips"] = flips
    spec.loader.exec_module(flips)
    bench = flips.Bench(finished, tmp_path)
    found = {flip: bench.outcome(flip) for flip in bench.flips(14, 7, 0.0)}
    assert not {flip: why for flip, (what, why) in found.items() if what == "WRONG"}
    assert sum(what == "refused" for what, _ in found.values()) >= 7
