"""Bad input through the real command line: one line, exit 1, nothing half-written, nothing lost.

Every case damages one thing in a workspace that a whole run has finished, gives a command, and
looks at all files before and after.
"""

from __future__ import annotations

import fcntl
import hashlib
import importlib.util
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from fusion.cli.app import app
from fusion.scaling.geometry import pair_size
from fusion.truth import make_mission
from fusion.truth.presets import MissionSettings
from fusion.workspace.settings import load_settings, write_settings

ROOT = Path(__file__).resolve().parents[1]
MAP, SUM, SHAPE = "MAPFILES/TR0003.MAP", "SUMFILES/P03I02.SUM", "SHAPEFILES/SHAPE.TXT"
TINY = MissionSettings.tiny()
PAIR_SIZE, _ = pair_size(TINY.body.radius, TINY.solution.gsd)
# Not results: the index and its lock, parts that a later run picks up, and the notes of runs.
ASIDE = (".lock", ".scratch", ".items", "catalog.sqlite", "provenance")
Edit = Callable[[bytes], bytes]


def call(*arguments: object, code: int = 0) -> Result:
    """Run a command in this process and check its exit code."""
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == code, result.output
    return result


def line_of(result: Result) -> str:
    """Return the one line that a refused command prints; standard output is empty."""
    assert result.exit_code == 1, result.output
    assert result.stdout == ""
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1
    assert "unexpected" not in result.stderr
    return result.stderr


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
    line = line_of(call(command[0], workspace, *command[1:], "--json", code=1))
    assert files_in(workspace) == before
    assert not list(workspace.rglob("*.part"))
    return line


def states(workspace: Path) -> dict[str, str]:
    """Run all stages, and return what became of each."""
    content = json.loads(call("run", workspace, "--json").stdout)
    return {one["stage"]: one["state"] for one in content["stages"]}


def program(*arguments: object, **options: Any) -> subprocess.Popen[str]:
    """Start a real process."""
    return subprocess.Popen(
        [sys.executable, "-m", "fusion.cli", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        **options,
    )


@pytest.fixture(scope="module")
def mission(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small synthetic mission; nobody changes it."""
    folder = tmp_path_factory.mktemp("bad input") / "mission"
    make_mission(folder, settings=TINY)
    return folder


@pytest.fixture(scope="module")
def finished(mission: Path) -> Path:
    """A workspace in a path with a space, in which all stages have run; nobody changes it."""
    root = mission.with_name("a finished workspace")
    call("init", root, "--spc", mission / "spc", "--body", "Truth")
    settings = load_settings(root / "spcola.toml").with_table("release", products=["map"])
    write_settings(root / "spcola.toml", settings.with_table("scale", size_m=PAIR_SIZE))
    call("import", root, *sorted((mission / "lidar").iterdir()))
    assert set(states(root).values()) == {"ran", "up to date"}
    return root


@pytest.fixture
def workspace(finished: Path, tmp_path: Path) -> Path:
    """A copy of the finished workspace, to be damaged."""
    root = tmp_path / "a copy"
    # Every writer replaces files whole, so that links to those of the finished one are enough.
    shutil.copytree(finished, root, symlinks=True, copy_function=_linked)
    return root


def _linked(source: str, target: str) -> None:
    """Link a file; the data base, which is written in place, is copied."""
    if source.endswith(".sqlite") or Path(source).is_symlink():
        shutil.copy2(source, target, follow_symlinks=False)
    else:
        os.link(source, target)


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


def gsd_times(factor: float) -> Edit:
    """Return an edit of a .MAP that multiplies the ground sample distance of its header."""

    def edit(content: bytes) -> bytes:
        gsd = np.frombuffer(content, ">f4", 1, 6)[0]
        return at(6, np.array(gsd * factor, ">f4").tobytes())(content)

    return edit


def in_metres(content: bytes) -> bytes:
    """Multiply every vertex of an ICQ text by a thousand."""
    first, *rest = content.decode().splitlines()
    rows = (" ".join(f"{1e3 * float(x.replace('D', 'E')):.6f}" for x in r.split()) for r in rest)
    return "\n".join([first, *rows, ""]).encode()


def folder_instead(path: Path) -> None:
    path.unlink()
    path.mkdir()


def link_to_nowhere(path: Path) -> None:
    path.unlink()
    path.symlink_to("nowhere")


EMPTY: Edit = lambda _: b""  # noqa: E731
HALF: Edit = lambda content: content[: len(content) // 2]  # noqa: E731
RUBBISH: Edit = lambda _: b"rubbish, and more of it" * 40  # noqa: E731

SPC_FILES = {
    "map, cut in its data": (MAP, HALF, "truncated, or q is mis-declared"),
    "map, cut in its header": (MAP, lambda c: c[:50], "the header has 72"),
    "map, empty": (MAP, EMPTY, "is empty"),
    "map, q against its length": (MAP, at(10, b"\x10\x00"), "q is mis-declared"),
    "map, rubbish": (MAP, RUBBISH, "q is mis-declared"),
    "map, GSD byte-swapped": (MAP, lambda c: at(6, c[6:10][::-1])(c), "GSD"),
    "map, GSD not a number": (MAP, at(6, b"\x7f\xc0\x00\x00"), "GSD"),
    "map, GSD in metres": (MAP, gsd_times(1e3), "metres"),
    "sigma, cut": ("MAPFILES/TR0003.SIG", lambda c: c[:-7], "TR0003.SIG"),
    "sigma, empty": ("MAPFILES/TR0003.SIG", EMPTY, "is empty"),
    "list of maps, a name twice": ("MAPLIST.TXT", swapped("TR0003", "TR0002"), "line 3"),
    "list of maps, no END": ("MAPLIST.TXT", swapped("END\n", ""), "END"),
    "list of maps, empty file": ("MAPLIST.TXT", EMPTY, "is empty"),
    "list of maps, no names": ("MAPLIST.TXT", lambda _: b"END\n", "lists nothing"),
    "list of maps, no text": ("MAPLIST.TXT", lambda _: b"\xff\xfe\x00", "line 1"),
    "list of maps, a path": ("MAPLIST.TXT", swapped("TR0003", "../etc"), "line 3"),
    "list of maps, a map that is not": (
        "MAPLIST.TXT",
        swapped("TR0003", "XX0003"),
        "take its name off the list",
    ),
    "list of images, a name twice": ("PICTLIST.TXT", swapped("P03I02", "P03I01"), "line 8"),
    "list of images, no SUM file": (
        "PICTLIST.TXT",
        swapped("P03I02", "XX0003"),
        "SUMFILES/XX0003.SUM",
    ),
    "SUM, cut": (SUM, HALF, "line "),
    "SUM, empty": (SUM, EMPTY, "is empty"),
    "SUM, not a number": (SUM, line_set(5, "  NaN  0.0  0.0  SCOBJ"), "line 5"),
    "shape, cut": (SHAPE, HALF, "line "),
    "shape, empty": (SHAPE, EMPTY, "is empty"),
    "shape, not a number": (SHAPE, line_set(41, "NaN NaN NaN"), "line 41"),
    "shape, in metres": (SHAPE, in_metres, "mean radius"),
}


@pytest.mark.parametrize("case", SPC_FILES)
def test_a_damaged_input_is_one_line_and_changes_nothing(workspace: Path, case: str) -> None:
    name, edit, words = SPC_FILES[case]
    damage(workspace, name, edit)
    line = refused(workspace, "run")
    assert words in line
    assert Path(name).parts[0].removesuffix(".TXT")[:4] in line or "XX0003" in line


@pytest.mark.parametrize("make", [folder_instead, link_to_nowhere, Path.unlink])
@pytest.mark.parametrize("name", [MAP, SUM, "MAPFILES/TR0003.SIG"])
def test_a_file_that_is_gone_or_a_folder_is_named(
    workspace: Path, name: str, make: Callable[[Path], None]
) -> None:
    make(workspace / name)
    if name.endswith(".SIG") and make is Path.unlink:
        call("info", workspace)  # a maplet needs no sigma companion
    else:
        assert name in refused(workspace, "run")


@pytest.mark.parametrize("make", [folder_instead, link_to_nowhere])
@pytest.mark.parametrize("name", ["MAPLIST.TXT", "PICTLIST.TXT", SHAPE, "scans/scan03.h5"])
def test_a_list_shape_or_scan_is_never_passed_over(
    workspace: Path, name: str, make: Callable[[Path], None]
) -> None:
    if name == SHAPE and make is folder_instead:
        pytest.skip("a folder in SHAPEFILES may be anything")
    make(workspace / name)
    assert name in refused(workspace, "run")


def test_a_source_folder_that_went_away_is_named(mission: Path, tmp_path: Path) -> None:
    spc = shutil.copytree(mission / "spc", tmp_path / "spc")
    call("init", tmp_path / "ws", "--spc", spc)
    call("import", tmp_path / "ws", mission / "lidar" / "scan01.dat")
    spc.rename(tmp_path / "unmounted")
    assert "MAPLIST.TXT" in refused(tmp_path / "ws", "run")
    (tmp_path / "ws" / "MAPLIST.TXT").unlink()
    (tmp_path / "ws" / "LMRKLIST.TXT").unlink()
    assert "which is not there; bring that back" in refused(tmp_path / "ws", "run")


def test_a_folder_that_cannot_be_listed_is_named(workspace: Path) -> None:
    shutil.rmtree(workspace / "scans")
    (workspace / "scans").write_text("a file")
    assert f"{workspace / 'scans'}: cannot be listed" in refused(workspace, "run")


NOBODY = """
import os, sys
from fusion.cli.app import main
import fusion.inspection.describe, fusion.runtime.executor, fusion.stages
fusion.stages.load_stages()  # the installation may be closed to others, too
os.setgid(65534)
os.setuid(65534)
sys.argv = ["spcola", "run", sys.argv[1], "--json"]
main()
"""


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become somebody else")
@pytest.mark.parametrize("locked", [MAP, "SUMFILES", "scans", "spcola.toml", "."])
def test_what_may_not_be_read_or_written_is_named(
    finished: Path, open_folder: Path, locked: str
) -> None:
    """A run by somebody without permission, in a process of their own."""
    root = shutil.copytree(finished, open_folder / "ws")  # links become files of this folder
    for path in (root, *root.rglob("*")):
        os.chown(path, 65534, 65534)
    shut = root / locked
    os.chown(shut, 0, 0)
    shut.chmod(0o555 if locked == "." else 0o700)
    before = files_in(root)
    command = [sys.executable, "-c", NOBODY, str(root)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    assert (done.returncode, done.stdout) == (1, ""), done.stderr
    assert done.stderr.startswith(f"error: {root if locked == '.' else shut}")
    assert done.stderr.count("\n") == 1
    assert files_in(root) == before


@pytest.fixture
def open_folder() -> Iterator[Path]:
    """A folder that others may enter, which pytest's own are not."""
    folder = Path(tempfile.mkdtemp())
    folder.chmod(0o755)
    yield folder
    shutil.rmtree(folder)


SETTINGS = {
    "a word for a number": ("capture_m = 2.0", 'capture_m = "two"', "[register] capture_m"),
    "out of range": ("capture_m = 2.0", "capture_m = -1.0", "[register] capture_m"),
    "not a number": ("capture_m = 2.0", "capture_m = nan", "[register] capture_m"),
    "infinite": ("capture_m = 2.0", "capture_m = inf", "[register] capture_m"),
    "an unknown key": ("capture_m = 2.0", "capture = 2.0", "known are model"),
    "a key twice": ("capture_m = 2.0", "capture_m = 2.0\ncapture_m = 3.0", "at line"),
    "an unknown table": ("[register]", "[registration]", "known are [body]"),
    "a value for a table": ("[fuse]", "fuse = 3\n[x]", "unknown key"),
    "an unknown choice": ('model = "similarity"', 'model = "projective"', "'affine'"),
    "a latitude of 95 degrees": ("latitude_deg = 90.0", "latitude_deg = 95.0", "[bigmap] sites"),
    "a body's name on two lines": ('name = "Truth"', 'name = "Tru\\nth"', "[body] name"),
    "a body's name outside ASCII": ('name = "Truth"', 'name = "Чурюмов"', "[body] name"),
    "a shape that is not": ('shape = ""', 'shape = "none.obj"', "none.obj"),
    "two sites of one name": ('"NPOLE"', '"SPOLE"', "[bigmap] sites"),
}


@pytest.mark.parametrize("case", SETTINGS)
def test_a_wrong_setting_is_named(workspace: Path, case: str) -> None:
    old, new, words = SETTINGS[case]
    damage(workspace, "spcola.toml", swapped(old, new))
    line = refused(workspace, "fuse" if "none.obj" in new else "run")
    assert words in line
    assert "spcola.toml" in line or "none.obj" in line


@pytest.mark.parametrize(
    "edit", [lambda c: c[: c.index(b"capture_m") + 4], lambda _: b"\xff\xfe\x00"]
)
def test_settings_that_are_no_toml_are_named(workspace: Path, edit: Edit) -> None:
    damage(workspace, "spcola.toml", edit)
    assert "spcola.toml: is not" in refused(workspace, "run")


TOO_LARGE = {
    "mapolas": ("half_size = 0", "half_size = 10000", "[mapolas]"),
    "register": ("capture_m = 2.0", "capture_m = 1e5", "[register] capture_m"),
    "scale": (f"size_m = {PAIR_SIZE}", "size_m = 1e8", "[scale]"),
    "bigmap": ("size_m = 0.0, gsd_m", "size_m = 1e8, gsd_m", "[bigmap] site NPOLE"),
}


@pytest.mark.parametrize("stage", TOO_LARGE)
def test_a_grid_beyond_all_memory_is_refused_before_it_is_made(workspace: Path, stage: str) -> None:
    old, new, where = TOO_LARGE[stage]
    damage(workspace, "spcola.toml", swapped(old, new))
    line = refused(workspace, stage)
    assert where in line
    assert "GB of memory" in line


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
def test_a_damaged_scan_is_read_again_from_its_file_or_refused(
    workspace: Path, mission: Path, tmp_path: Path, case: str
) -> None:
    before = files_in(workspace)
    damage(workspace, SCAN, SCAN_DAMAGES[case])
    assert SCAN in refused(workspace, "mapolas")
    problems = json.loads(call("info", workspace, "--json").stdout)["problems"]
    assert case == "garbled inside" or [SCAN in text for text in problems] == [True]
    content = json.loads(call("run", workspace, "--json").stdout)
    (note,) = [text for text in content["stages"][0]["notes"] if "read again" in text]
    assert "scan03 was damaged" in note
    assert files_in(workspace) == before
    if case == "cut":
        source = mission / "lidar" / "scan03.dat"
        damage(workspace, SCAN, HALF)
        aside = source.rename(tmp_path / "aside.dat")
        try:
            assert "is gone; restore one of them" in refused(workspace, "run")
        finally:
            aside.rename(source)


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
    assert json.loads(call("fuse", workspace, "--json").stdout)["state"] == "up to date"


def test_a_lidar_file_that_lost_returns_is_not_read_again_in_silence(
    workspace: Path, mission: Path
) -> None:
    """Cut at the end of a record, and with the time of writing that it had."""
    source = mission / "lidar" / "scan03.dat"
    whole, state = source.read_bytes(), source.stat()
    try:
        source.write_bytes(whole[: 186 * 400])
        os.utime(source, ns=(state.st_atime_ns, state.st_mtime_ns))
        line = refused(workspace, "run")
        assert "has changed since it was imported as scan03" in line
        assert "spcola import" in line
        again = json.loads(call("import", workspace, source, "--json").stdout)["scans"][0]
        assert again["state"] == "imported again"
        assert again["returns"] < again["returns_before"]
    finally:
        source.write_bytes(whole)
        os.utime(source, ns=(state.st_atime_ns, state.st_mtime_ns))


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
    problems = json.loads(call("info", workspace, "--json").stdout)["problems"]
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


def write_table(path: Path, points: Any, header: str = "x_m,y_m,z_m") -> Path:
    rows = [",".join(map(repr, map(float, point))) for point in points]
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


OLA: dict[str, Edit] = {
    "empty": EMPTY,
    "cut in a record": lambda c: c[: 186 * 40 + 93],
    "byte-swapped": lambda c: np.frombuffer(c, "<u8", len(c) // 8).byteswap().tobytes(),
    "shifted": lambda c: c[50:],
    "all zero": lambda c: bytes(186 * 40),
    "rubbish": RUBBISH,
}


@pytest.mark.parametrize("case", OLA)
def test_a_damaged_lidar_file_leaves_nothing_behind(
    mission: Path, tmp_path: Path, case: str
) -> None:
    call("init", tmp_path / "ws")
    bad = tmp_path / "bad.dat"
    bad.write_bytes(OLA[case]((mission / "lidar" / "scan01.dat").read_bytes()))
    assert str(bad) in line_of(call("import", tmp_path / "ws", bad, "--json", code=1))
    assert files_in(tmp_path / "ws").keys() == {"spcola.toml"}


def test_returns_in_another_unit_than_the_shape_are_refused_at_import(
    mission: Path, tmp_path: Path
) -> None:
    """Metres called kilometres cannot be detected in a table alone, but with a shape."""
    root = tmp_path / "ws"
    call("init", root, "--spc", mission / "spc")
    far = np.random.default_rng(3).normal(size=(500, 3)) * 40.0
    table = write_table(tmp_path / "far.csv", far, "x_km,y_km,z_km")
    line = line_of(call("import", root, table, code=1))
    assert "outside the radius limits" in line
    assert "km for m" in line
    assert not (root / "scans" / "far.h5").exists()


def test_returns_outside_the_grids_are_refused_by_the_mapolas(
    mission: Path, tmp_path: Path
) -> None:
    """Another body of the same size: its returns lie where no maplet is."""
    root = tmp_path / "ws"
    call("init", root, "--spc", mission / "spc")
    away = np.random.default_rng(3).normal(loc=(150.0, 0.0, 0.0), size=(500, 3))
    call("import", root, write_table(tmp_path / "away.csv", away, "x_m,y_m,z_m"))
    line = refused(root, "mapolas")
    assert "the same frame and unit" in line
    assert "is covered" in line


@pytest.mark.parametrize("name", ["a/b", "..", ".hidden", "two\nlines"])
def test_a_scans_name_cannot_leave_its_folder(tmp_path: Path, name: str) -> None:
    call("init", tmp_path / "ws")
    table = write_table(tmp_path / "track.csv", np.eye(3) + 5.0)
    result = call("import", tmp_path / "ws", table, "--name", name, "--json", code=1)
    assert "is no name for a scan" in line_of(result)
    assert files_in(tmp_path / "ws").keys() == {"spcola.toml"}


def test_two_files_of_one_name_are_refused_before_either_is_read(tmp_path: Path) -> None:
    call("init", tmp_path / "ws")
    (tmp_path / "b").mkdir()
    files = [
        write_table(tmp_path / sub / "t.csv", np.eye(3) + n) for n, sub in enumerate((".", "b"))
    ]
    assert "--name" in line_of(call("import", tmp_path / "ws", *files, "--json", code=1))
    assert files_in(tmp_path / "ws").keys() == {"spcola.toml"}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--spc", "nowhere"], "is no SPC working folder"),
        (["--spc", "bad.obj"], "is no SPC working folder"),
        (["--shape", "nowhere.obj"], "nowhere.obj: cannot be read"),
        (["--shape", "bad.obj"], "give ICQ, OBJ or PLY"),
        (["--shape", "."], "cannot be read"),
        (["--body", ""], "[body] name"),
        (["--spc", "broken"], "leads nowhere"),
    ],
)
def test_init_makes_no_half_workspace(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: list[str], words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("bad.obj").write_text("bad\n")
    Path("broken/MAPFILES").mkdir(parents=True)
    Path("broken/MAPFILES/A.MAP").symlink_to("nowhere")
    assert words in line_of(call("init", "ws", *options, "--json", code=1))
    assert not Path("ws").exists()


def test_init_in_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("precious")
    for target in (tmp_path / "file", tmp_path / "file" / "ws"):
        assert "cannot be created" in line_of(call("init", target, code=1))
    assert (tmp_path / "file").read_text() == "precious"


@pytest.mark.parametrize("folders", [["workspace"], ["mission/spc", "mission/lidar"]])
def test_a_demo_never_removes_what_it_did_not_make(tmp_path: Path, folders: list[str]) -> None:
    for folder in folders:
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "precious").write_text("a year of work")
    before = files_in(tmp_path)
    assert "holds other things" in line_of(call("demo", tmp_path, "--json", code=1))
    assert files_in(tmp_path) == before


def test_the_second_of_two_runs_is_refused(workspace: Path) -> None:
    with (workspace / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert "another spcola is at work here" in refused(workspace, "run")
        call("info", workspace)
    assert set(states(workspace).values()) == {"up to date"}


def wait_for(path: Path, process: subprocess.Popen[str]) -> None:
    """Wait until `path` is there while `process` runs."""
    until = time.monotonic() + 60
    while not path.exists() and process.poll() is None and time.monotonic() < until:
        time.sleep(0.01)
    assert path.exists(), process.communicate()


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_a_run_that_is_interrupted_or_killed_can_be_finished(
    workspace: Path, finished: Path, how: signal.Signals
) -> None:
    shutil.rmtree(workspace / "fused")
    before = files_in(workspace)
    # A job in the background of a shell would hand down that interrupts are ignored.
    heed = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    with program("run", workspace, "--workers", "1", preexec_fn=heed) as process:
        wait_for(workspace / ".scratch" / "fuse", process)
        wait_for(workspace / "fused", process)
        time.sleep(0.3)
        process.send_signal(how)
        out, err = process.communicate(timeout=60)
    assert out == ""
    if how == signal.SIGINT:
        assert process.returncode == 130
        assert err.splitlines()[-1].startswith("interrupted: ")
    now = files_in(workspace)
    assert {name: now[name] for name in before} == before
    assert all(Path(name).parts[1].startswith(".") for name in now.keys() - before.keys())
    assert states(workspace)["fuse"] == "ran"
    assert files_in(workspace).keys() == files_in(finished).keys()
    assert (workspace / "fused/TR0003.MAP").read_bytes() == (
        finished / "fused/TR0003.MAP"
    ).read_bytes()


def limited() -> None:
    """Let no file grow beyond 400 kB: what a full disk does, without one."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, 400_000))


@pytest.mark.parametrize(("stage", "place"), [("mapolas", "mapolas"), ("release", "fused.h5")])
def test_a_full_disk_leaves_what_was_there(workspace: Path, stage: str, place: str) -> None:
    before = files_in(workspace)
    command = [stage, workspace, "--force"]
    with program(*command, preexec_fn=limited) as process:
        out, err = process.communicate(timeout=120)
    assert (process.returncode, out) == (1, ""), err
    lines = [line for line in err.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1
    assert place in lines[0]
    assert "unexpected" not in err
    assert files_in(workspace) == before


@pytest.mark.parametrize(
    ("json_mode", "buffering"), [([], {}), (["--json"], {"PYTHONUNBUFFERED": "1"})]
)
def test_a_full_disk_under_standard_output_is_one_line(
    workspace: Path, json_mode: list[str], buffering: dict[str, str]
) -> None:
    command = [sys.executable, "-m", "fusion.cli", "info", str(workspace), *json_mode]
    # With and without a buffer between the program and the disk.
    buffered = {k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"}
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            command,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
            cwd=ROOT,
            env={**buffered, **buffering},
        )
    assert done.returncode == 1
    assert done.stderr == "error: standard output: cannot be written (No space left on device)\n"


def test_help_comes_without_the_machinery() -> None:
    """Half a second of imports before every help text would be felt; a clock would not be fair."""
    script = (
        "import sys, fusion.cli.app;"
        "print([m for m in ('numpy', 'scipy', 'numba', 'h5py', 'open3d') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert done.stdout == "[]\n"


def test_it_runs_from_anywhere_and_in_a_pipe(workspace: Path, tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-m", "fusion.cli", "info", f"../{workspace.name}", "--json"],
        capture_output=True,
        text=True,
        check=True,
        cwd=workspace / "scans" / "..",
        env=environment,
    )
    assert json.loads(done.stdout)["maplets"] == 24
    assert done.stderr == ""


REAL = {
    "moon_lola/lidarPoints.csv": "lidar (lola)",
    "ryugu/hyb2_ldr_l2_aocsm_topo_ts_20180701_odd_rows.csv": "lidar (hayabusa2)",
    "ryugu/ryugu_sfm_v20180804_decimated.obj": "shape (obj, taken as km)",
    "bennu/g_12570mm_alt_obj_0000n00000_v014.obj": "shape (obj, taken as km)",
    "bennu/SHAPE_bennu_ola_v014_q32.TXT": "shape (icq, taken as km)",
    "bennu/OLA001.MAP": "maplet",
    "bennu/spc_states_181108/orx_s_181108_181217_ALTP_v01.bsp": "SPICE kernel (binary)",
    "bennu/spc_states_181108/bennu_pck_od090.tpc": "SPICE kernel (text)",
    "bennu/kernels_mapcam_20190303/orex_ocams_addendum_v10.ti": "SPICE kernel (text)",
    "bennu/kernels_mapcam_20190303/20190303T100344S990_map_iofL2pan_V001_0.xsp": (
        "SPICE kernel (transfer text)"
    ),
    "rosetta_67p/W48230079013.SUM": "image summary",
    "rosetta_67p/FA0115.LMK": "landmark",
    "pointcloud/autzen_trim.laz": "lidar (las)",
    "pointcloud/noise-dirty.las": "lidar (las)",
}


@pytest.mark.real_data
def test_info_recognises_every_real_file_or_refuses_it_in_one_line(shared_data: Path) -> None:
    for path in sorted(path for path in shared_data.rglob("*") if path.is_file()):
        result = CliRunner().invoke(app, ["info", str(path), "--json"])
        known = REAL.get(str(path.relative_to(shared_data)))
        if result.exit_code == 0:
            assert json.loads(result.stdout)["kind"] == (known or json.loads(result.stdout)["kind"])
        else:
            assert known is None, result.output
            assert str(path) in line_of(result)
