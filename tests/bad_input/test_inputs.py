"""Damaged inputs and settings are refused in one line; nothing is lost."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from command_line import ROOT, call
from damage import (
    EMPTY,
    HALF,
    PAIR_SIZE,
    RUBBISH,
    Edit,
    at,
    damage,
    files_in,
    line_set,
    refused,
    swapped,
)

MAP, SUM, SHAPE = "MAPFILES/TR0003.MAP", "SUMFILES/P03I02.SUM", "SHAPEFILES/SHAPE.TXT"


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
from fusion.cli.app import command_line, main
import fusion.inspection.describe, fusion.runtime.executor, fusion.stages
command_line()  # the installation may be closed to others, too
fusion.stages.load_stages()
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
