"""``spcola truth make``: output, refusals, and that a killed run resumes."""

from __future__ import annotations

import hashlib
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from command_line import app
from typer.testing import CliRunner, Result

from fusion.truth import PRESETS, read_truth

ROOT = Path(__file__).resolve().parents[3]


def call(*arguments: object, code: int = 0) -> Result:
    """Run a command and check its exit code."""
    result = CliRunner().invoke(app, ["truth", "make", *map(str, arguments)])
    assert result.exit_code == code, result.output
    return result


def digests(root: Path) -> dict[str, str]:
    """Return the digest of every file below `root`, by its path."""
    return {
        path.relative_to(root).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in root.rglob("*")
        if path.is_file()
    }


def program(*arguments: object) -> subprocess.Popen[str]:
    """Start the real command line."""
    return subprocess.Popen(
        [sys.executable, "-m", "fusion.cli", "truth", "make", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    )


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Result]:
    root = tmp_path_factory.mktemp("undisturbed") / "tiny"
    return root, call(root, "--preset", "tiny", "--seed", 7, "--json")


def test_one_object_contains_what_was_made_and_its_size(
    undisturbed: tuple[Path, Result],
) -> None:
    root, result = undisturbed
    assert result.stderr == ""
    content = json.loads(result.stdout)
    assert (content["folder"], content["preset"], content["seed"]) == (str(root), "tiny", 7)
    assert content["planted"]["epsilon"] == read_truth(root).epsilon
    assert read_truth(root).settings == PRESETS["tiny"](7)


def test_the_forecast_size_is_the_size_found_after(undisturbed: tuple[Path, Result]) -> None:
    root, result = undisturbed
    size = json.loads(result.stdout)["size"]
    planted = read_truth(root)
    assert size["scans"] == len(planted.scans) == len(list((root / "lidar").iterdir()))
    assert size["bytes"] == pytest.approx(sum(planted.files.values()), rel=0.1)


@pytest.mark.parametrize("after", ["lidar/scan03.dat", "spc/MAPFILES/TR0009.MAP"])
def test_a_killed_run_goes_on_and_ends_with_the_same_bytes(
    after: str, undisturbed: tuple[Path, Result], tmp_path: Path
) -> None:
    root = tmp_path / "tiny"
    run = program(root, "--preset", "tiny", "--seed", 7)
    deadline = time.monotonic() + 120.0
    while not (root / after).exists() and run.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    run.send_signal(signal.SIGKILL)
    run.communicate()
    assert run.returncode == -signal.SIGKILL
    assert not (root / "truth.json").exists()
    kept = {path: path.stat().st_mtime_ns for path in (root / "lidar").glob("scan*.dat")}
    assert kept
    call(root, "--preset", "tiny", "--seed", 7)
    assert digests(root) == digests(undisturbed[0])
    assert {path: path.stat().st_mtime_ns for path in kept} == kept


def test_the_size_alone_makes_nothing(tmp_path: Path) -> None:
    result = call(tmp_path / "new", "--preset", "bennu", "--dry-run")
    assert "returns" in result.stdout
    assert "on disk" in result.stdout
    assert not (tmp_path / "new").exists()


def test_settings_are_changed_by_their_names(tmp_path: Path) -> None:
    def size(*more: str) -> dict[str, float]:
        result = call(tmp_path / "new", "--preset", "tiny", "--dry-run", "--json", *more)
        return dict(json.loads(result.output)["size"])

    usual = size()
    wide = size("--set", "lidar.width=120", "--set", "passes.count=16")
    assert wide["returns"] == pytest.approx(8 * usual["returns"], rel=0.02)
    refused = call(tmp_path / "new", "--set", "lidar.widht=120", code=1)
    assert "there is no entry widht; known: width, spacing" in refused.output


def test_another_mission_and_other_things_are_left_alone(
    undisturbed: tuple[Path, Result], tmp_path: Path
) -> None:
    line = call(undisturbed[0], "--preset", "tiny", code=1).stderr.splitlines()[-1]
    assert line.startswith("error: ")
    assert "holds another mission" in line
    (tmp_path / "thesis.tex").write_text("years of work")
    assert "other things" in call(tmp_path, "--preset", "tiny", code=1).stderr


def test_help_has_an_example_and_a_wrong_preset_is_wrong_usage(tmp_path: Path) -> None:
    assert "Example: spcola truth make" in call("--help").stdout
    assert "--preset" in call(tmp_path, "--preset", "ceres", code=2).stderr
    text = CliRunner().invoke(app, ["truth", "--help"]).stdout
    assert "make" in text
    assert "assess" in text
