"""The command line: help, exit codes, one line for errors, JSON and nothing else."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import ROOT, call, called, program, refused

from fusion.cli.app import COMMANDS
from fusion.workspace import Workspace
from spcola.formats.maplets import write_maplet
from spcola.grids import Maplet, MapletGrid


def write_table(path: Path, points: np.ndarray[Any, Any]) -> Path:
    rows = [",".join(repr(float(x)) for x in point) for point in points]
    path.write_text("\n".join(["x_m,y_m,z_m", *rows]) + "\n")
    return path


@pytest.fixture
def table(tmp_path: Path) -> Path:
    return write_table(tmp_path / "track.csv", np.arange(30.0).reshape(10, 3) + 100.0)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    call("init", tmp_path / "ws")
    return tmp_path / "ws"


@pytest.mark.parametrize("command", [name for name, _, _ in COMMANDS])
def test_every_command_has_help_with_an_example(command: str) -> None:
    text = call(command, "--help").stdout
    assert f"Example: spcola {command}" in text
    assert "--json" in text


def test_help_and_version_of_the_whole() -> None:
    assert all(name in call("--help").stdout for name, _, _ in COMMANDS)
    assert call("--version").stdout.startswith("spcola 0.")


@pytest.mark.parametrize(
    "arguments",
    [
        ["nonsense"],
        ["init"],
        ["init", "ws", "--nonsense"],
        ["init", "ws", "--spc", "a", "--shape", "b"],
        ["import", "ws"],
        ["import", "ws", "a", "b", "--name", "one"],
        ["scale", "ws", "--method", "guess"],
    ],
)
def test_wrong_usage_exits_with_2(arguments: list[str], tmp_path: Path) -> None:
    (tmp_path / "ws").mkdir()
    here = Path.cwd()
    os.chdir(tmp_path)
    try:
        assert call(*arguments, code=2).stdout == ""
    finally:
        os.chdir(here)


def test_a_setting_on_the_command_line_out_of_range_is_wrong_usage(folder: Path) -> None:
    assert "--gsd" in call("mapolas", folder, "--gsd", "-1", code=2).stderr


def test_init_prints_what_it_found(tmp_path: Path) -> None:
    made = called("init", tmp_path / "ws", "--body", "Bennu")
    assert (made["body"], made["maplets"], made["scans"]) == ("Bennu", 0, 0)
    assert "is a workspace already" in refused("init", tmp_path / "ws")


def test_a_file_is_imported_once(folder: Path, table: Path) -> None:
    (first,) = called("import", folder, table)["scans"]
    assert (first["scan"], first["returns"], first["state"]) == ("track", 10, "imported")
    before = (folder / "scans" / "track.h5").stat().st_mtime_ns
    (again,) = called("import", folder, table)["scans"]
    assert again["state"] == "imported already"
    copy = table.with_name("other-name.csv")
    copy.write_bytes(table.read_bytes())
    (same,) = called("import", folder, copy)["scans"]
    assert (same["scan"], same["state"]) == ("track", "imported already")
    assert (folder / "scans" / "track.h5").stat().st_mtime_ns == before
    assert called("info", folder)["returns"] == 10


def test_another_file_of_the_same_name_is_refused(folder: Path, table: Path) -> None:
    call("import", folder, table)
    (table.parent / "b").mkdir()
    other = write_table(table.parent / "b" / "track.csv", np.ones((3, 3)))
    assert "--name" in refused("import", folder, other)
    (named,) = called("import", folder, other, "--name", "second")["scans"]
    assert (named["scan"], named["returns"]) == ("second", 3)
    fresh = [
        write_table(table.parent / sub / "new.csv", np.eye(3) + n)
        for n, sub in enumerate(("", "b"))
    ]
    assert "new" in refused("import", folder, *fresh)
    assert called("info", folder)["scans"] == 2


def test_columns_are_named_with_their_units(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "named.csv"
    path.write_text("A,B,C\n1,2,3\n4,5,6\n")
    columns = ["--columns", "x=A [km],y=B [km]", "--columns", "z=C [m]"]
    (scan,) = called("import", folder, path, *columns)["scans"]
    assert scan["highest_m"] == [4000.0, 5000.0, 6.0]
    assert "QUANTITY=COLUMN" in call("import", folder, path, "--columns", "x", code=2).stderr


def test_rejected_returns_are_counted_by_reason(folder: Path, tmp_path: Path) -> None:
    table = write_table(tmp_path / "far.csv", np.array([[100.0, 0, 0], [9999.0, 0, 0]]))
    text = (folder / "spcola.toml").read_text()
    (folder / "spcola.toml").write_text(text.replace("max_radius_m = 0.0", "max_radius_m = 500.0"))
    (scan,) = called("import", folder, table)["scans"]
    assert scan["returns"] == 1
    assert sum(scan["rejected"].values()) == 1
    assert "rejected: 1 " in call("import", folder, table).stdout


@pytest.mark.parametrize("content", ["", "x_m,y_m,z_m\n1,2\n", "\0\0\0\0 rubbish"])
def test_a_bad_file_leaves_nothing_behind(folder: Path, tmp_path: Path, content: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(content)
    assert str(path) in refused("import", folder, path)
    assert list((folder / "scans").iterdir()) == []


def test_a_missing_file_or_workspace_is_named(folder: Path, tmp_path: Path, table: Path) -> None:
    assert "nowhere.csv" in refused("import", folder, tmp_path / "nowhere.csv")
    assert "is not a folder" in refused("import", tmp_path / "none", table)
    assert "spcola init" in refused("info", tmp_path)


def test_a_changed_import_setting_reads_the_file_again(folder: Path, table: Path) -> None:
    call("import", folder, table)
    text = (folder / "spcola.toml").read_text()
    (folder / "spcola.toml").write_text(text.replace("max_radius_m = 0.0", "max_radius_m = 200.0"))
    assert called("info", folder)["stages"]["ingest"] == "due"
    (state,) = [s for s in called("run", folder)["stages"] if s["stage"] == "ingest"]
    assert (state["state"], state["summary"]["returns"]) == ("ran", 5)
    table.unlink()
    (folder / "spcola.toml").write_text(text)
    assert "its file is gone" in refused("run", folder)
    assert called("info", folder)["returns"] == 5


def test_settings_errors_name_file_and_key(folder: Path) -> None:
    with (folder / "spcola.toml").open("a") as file:
        file.write("\n[mapola]\n")
    message = refused("run", folder)
    assert str(folder / "spcola.toml") in message
    assert "[mapola]" in message


def test_run_of_an_empty_workspace_prints_what_to_do(folder: Path) -> None:
    assert "spcola import" in refused("run", folder)
    assert "spcola import" in refused("mapolas", folder)


def test_info_recognises_a_file(tmp_path: Path, table: Path, folder: Path) -> None:
    grid = MapletGrid.facing([0.0, 100.0, 0.0], [0.0, 1.0, 0.0], 0.5, 3)
    height = np.zeros(grid.shape)
    height[0, 0] = np.nan
    write_maplet(tmp_path / "AA0001.MAP", Maplet("AA0001", grid, height))
    facts = called("info", tmp_path / "AA0001.MAP")
    assert (facts["kind"], facts["half_size"], facts["missing"]) == ("maplet", 3, 1)
    assert facts["gsd_m"] == pytest.approx(0.5, rel=1e-6)
    assert facts["longitude_deg"] == pytest.approx(90.0)
    assert called("info", table)["kind"] == "lidar (table)"
    assert called("info", folder / "spcola.toml")["scale"]["method"] == "pairs"
    assert "half_size: 3" in call("info", tmp_path / "AA0001.MAP").stdout
    assert str(tmp_path / "none") in refused("info", tmp_path / "none")


def test_info_distinguishes_point_clouds_and_meshes_in_ply(tmp_path: Path) -> None:
    head = "ply\nformat ascii 1.0\nelement vertex 4\n" + "".join(
        f"property float {axis}\n" for axis in "xyz"
    )
    points = "end_header\n1 0 0\n0 1 0\n0 0 1\n-1 -1 -1\n"
    (tmp_path / "cloud.ply").write_text(head + points)
    facts = called("info", tmp_path / "cloud.ply")
    assert (facts["kind"], facts["returns"]) == ("lidar (cloud)", 4)
    faces = "element face 4\nproperty list uchar int vertex_indices\n"
    facets = "3 0 1 2\n3 0 3 1\n3 1 3 2\n3 2 3 0\n"
    (tmp_path / "mesh.ply").write_text(head + faces + points + facets)
    assert called("info", tmp_path / "mesh.ply")["facets"] == 4


def test_a_pipe_is_called_what_it_is(folder: Path) -> None:
    """… and neither empty nor missing."""
    for words in (("info", "/dev/stdin"), ("import", folder, "/dev/stdin")):
        process = program(*words, stdin=subprocess.PIPE)
        output, errors = process.communicate("x [m],y [m],z [m]\n1,2,3\n", timeout=60)
        assert (process.returncode, output) == (1, "")
        assert "not a regular file" in errors
        assert errors.count("\n") == 1


def test_info_works_where_nothing_can_be_written(table: Path, folder: Path) -> None:
    """… also on files that changed since their digests were made, and without a catalogue."""
    call("import", folder, table)
    for path in (folder / "scans").glob("*.h5"):
        path.touch()
    look = f"{sys.executable} -m fusion.cli info {folder} --json"
    closed = f"mount --bind {folder} {folder} && mount -o remount,ro,bind {folder} {folder}"
    for change in ("true", f"rm {folder}/catalog.sqlite", f"echo x > {folder}/catalog.sqlite"):
        ran = subprocess.run(
            ["unshare", "-m", "sh", "-c", f"{change} && {closed} || exit 77; {look}"],
            capture_output=True,
            text=True,
            cwd=ROOT,
            check=False,
        )
        if ran.returncode == 77 or "unshare" in ran.stderr:
            pytest.skip(f"no read-only mounts here: {ran.stderr.strip()}")
        assert ran.returncode == 0, ran.stderr
        assert json.loads(ran.stdout)["stages"]["ingest"] == "up to date"


def test_what_nobody_expected_is_one_line_and_a_way_to_more(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: Workspace) -> None:
        raise ZeroDivisionError("of two\nlines")

    monkeypatch.setattr("fusion.inspection.workspace_facts.workspace_facts", fail)
    assert "unexpected ZeroDivisionError: of two lines; set SPCOLA_DEBUG=1" in refused(
        "info", folder
    )
    monkeypatch.setenv("SPCOLA_DEBUG", "1")
    assert "Traceback" in call("info", folder, code=1).stderr


def test_an_interrupt_exits_with_130(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(_: Workspace) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("fusion.inspection.workspace_facts.workspace_facts", interrupt)
    result = call("info", folder, code=130)
    assert result.stderr.startswith("interrupted")


def test_a_real_process_prints_json_and_nothing_else(folder: Path, table: Path) -> None:
    with program("import", folder, table, "--json") as process:
        out, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (0, "")
    assert json.loads(out)["scans"][0]["returns"] == 10
    with program("run", folder / "nowhere") as process:
        out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (1, "")
    assert err.startswith("error: ")


def endless_table(path: Path) -> Path:
    """Write a table whose reading takes some seconds: a return, and comments behind it."""
    path.write_bytes(b"x_m,y_m,z_m\n1,2,3\n" + b"#\n" * 6_000_000)
    return path


def test_ctrl_c_leaves_the_workspace_usable(folder: Path, table: Path) -> None:
    endless_table(folder / "endless.csv")
    # A job in the background of a shell would hand down that interrupts are ignored.
    heed = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    with program("import", folder, folder / "endless.csv", preexec_fn=heed) as process:
        until = time.monotonic() + 60
        while not (folder / ".lock").exists() and time.monotonic() < until:
            time.sleep(0.02)
        time.sleep(0.3)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert err.startswith("interrupted")
    assert called("import", folder, table)["scans"][0]["returns"] == 10


def test_an_import_that_is_killed_keeps_what_it_had_imported(folder: Path, table: Path) -> None:
    """… and leaves no half scan; the next one goes on where it was."""
    endless = endless_table(folder / "endless.csv")
    with program("import", folder, table, endless) as process:
        until = time.monotonic() + 60
        while not list((folder / "scans").glob("[!.]*.h5")) and time.monotonic() < until:
            time.sleep(0.02)
        process.send_signal(signal.SIGKILL)
        process.communicate(timeout=60)
    assert process.returncode == -signal.SIGKILL
    done = [path.name for path in (folder / "scans").glob("[!.]*")]
    assert len(done) == 1
    endless.unlink()
    endless.write_text(table.read_text().replace("1", "2"))
    scans = called("import", folder, table, endless)["scans"]
    assert [scan["state"] for scan in scans] == ["imported already", "imported"]
    names = {path.name for path in (folder / "scans").iterdir()}
    assert names == {*done, "endless.h5"}


def test_a_full_disk_is_one_line_and_nothing_is_half_written(folder: Path, tmp_path: Path) -> None:
    big = write_table(tmp_path / "big.csv", np.random.default_rng(1).normal(size=(20_000, 3)))

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))

    with program("import", folder, big, preexec_fn=limit) as process:
        out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (1, ""), err
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert "big.h5" in err
    assert list((folder / "scans").iterdir()) == []
    assert called("import", folder, big)["scans"][0]["returns"] == 20_000
