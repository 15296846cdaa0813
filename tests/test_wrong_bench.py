"""`scripts/bench/wrong.py`: its table of wrong input, and that it can fail."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[1]
WAYS = ("turn 90 z", "mirror x", "turn 2.9 z", "cloud", "unit 0.001", "shift 5 0 0")
ARGUMENTS = ("--presets", "tiny", "--seed", "3")


@pytest.fixture(scope="module")
def bench() -> ModuleType:
    # By its path: the package of the same name would be found before it.
    path = ROOT / "scripts" / "bench" / "wrong.py"
    spec = importlib.util.spec_from_file_location("wrong_bench", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def kept(work: Path, name: str, verdict: str) -> None:
    """A result that the bench finds there and does not try again."""
    result = {"verdict": verdict, "step": "register", "codes": ["strain"], "line": "", "fits": ""}
    (work / f"tiny-{name}.json").write_text(json.dumps(result))


@pytest.mark.parametrize(
    ("wrong", "right", "faults"),
    [
        (("refused", "doubtful"), "accepted", 0),
        (("accepted", "refused"), "accepted", 1),
        (("refused", "refused"), "doubtful", 1),
        (("accepted", "accepted"), "refused", 3),
    ],
)
def test_wrong_input_that_passes_and_right_input_that_does_not_are_faults(
    bench: ModuleType,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    wrong: tuple[str, str],
    right: str,
    faults: int,
) -> None:
    kept(tmp_path, "3-turn_90_z", wrong[0])
    kept(tmp_path, "3-cloud", wrong[1])
    kept(tmp_path, "1-right", right)
    options = ("--ways", "turn 90 z", "cloud", "--right", "1", "--work", str(tmp_path))
    assert bench.main([*ARGUMENTS, *options]) == faults
    lines = capsys.readouterr().out.splitlines()
    accepted = wrong.count("accepted")
    assert sum("ACCEPTED" in line for line in lines) == accepted
    assert f"2 ways: {accepted} accepted" in lines
    assert f"1 missions: {int(right != 'accepted')} not accepted" in lines


@pytest.mark.slow
def test_no_wrong_input_is_accepted_and_right_input_is(
    bench: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(ROOT)  # its processes find the program by the current folder
    options = ("--ways", *WAYS, "--right", "1", "--work", str(tmp_path))
    faults = bench.main([*ARGUMENTS, *options])
    assert faults == 0, capsys.readouterr().out
    for path in tmp_path.glob("tiny-*.json"):
        result = json.loads(path.read_text())
        assert (result["verdict"] == "accepted") == path.stem.endswith("right")
        if result["verdict"] != "accepted":
            assert result["codes"] or result["line"], path
    fits = json.loads((tmp_path / "tiny-3-turn_90_z.json").read_text())["fits"]
    assert fits == "the lidar fits when turned by −90.0° about Z"
