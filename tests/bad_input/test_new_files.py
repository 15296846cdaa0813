"""Files that come in: lidar files, new workspaces, any real file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import app, call, line_of
from damage import (
    EMPTY,
    RUBBISH,
    Edit,
    files_in,
    refused,
)
from typer.testing import CliRunner

MAP, SUM, SHAPE = "MAPFILES/TR0003.MAP", "SUMFILES/P03I02.SUM", "SHAPEFILES/SHAPE.TXT"


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
