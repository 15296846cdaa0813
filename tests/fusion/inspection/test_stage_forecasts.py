"""Forecast of every stage: what is counted and kept, and that nothing but items is made."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from typing import Any

import pytest
from command_line import call

from fusion.inspection.forecasts import (
    Basis,
    StageForecast,
    forecast_json,
    forecast_lines,
    stage_forecasts,
)
from fusion.inspection.forecasts.timing import NotingStore, timed_sample
from fusion.pipeline import Pipeline
from fusion.pipeline.catalog.soundness import unsound_maplets
from fusion.runtime.folders import Remembered
from fusion.runtime.folders.remembered import Listing
from fusion.runtime.machine import PROGRAM_BYTES
from fusion.stages import load_stages, run_stages
from fusion.workspace import Workspace
from spcola.formats.maplets import read_map

_TICK_S = 0.03
STAGES = ["ingest", "mapolas", "register", "fuse", "bigmap", "scale", "release", "report"]


@pytest.fixture
def workspace(under_a_scan) -> Workspace:
    """Six maplets under one scan."""
    return under_a_scan([0.1 * number for number in range(6)])


def results(workspace: Workspace) -> list[str]:
    places = ("mapolas", "fused", "bigmaps", "pairs", "release")
    return [path.name for name in places for path in (workspace.home / name).rglob("*")]


def test_every_stage_has_a_forecast_and_nothing_is_run(workspace: Workspace) -> None:
    content = json.loads(call("run", workspace.root, "--forecast", "--json").stdout)["forecast"]
    assert list(content) == sorted(STAGES)
    assert results(workspace) == []
    assert content["mapolas"]["basis"] == "sample"
    for name in ("register", "fuse", "release"):
        assert content[name]["basis"] == "synthetic"
        assert content[name]["items"] >= 6
        assert 0.0 < content[name]["seconds"] < 120.0
        assert content[name]["disk_mb"] > 0.0
        assert content[name]["memory_mb"] > PROGRAM_BYTES / 1e6
    # There is no shape: no stage will make one.
    assert content["scale"]["basis"] == "unknown"
    assert "shape" in content["scale"]["reason"]
    assert content["scale"]["seconds"] is None


def test_items_of_the_sample_are_those_of_the_run(workspace: Workspace) -> None:
    settings = workspace.settings().with_table("mapolas", adjust=False)
    found = stage_forecasts(workspace, settings, only="mapolas", workers=1)["mapolas"]
    folder = workspace.home / ".items" / "mapolas"
    made = {path.name: path.stat().st_mtime_ns for path in folder.iterdir()}
    assert (found.items, found.kept) == (6, 0)
    assert 2 <= len(made) < 6
    toml = workspace.root / "spcola.toml"
    toml.write_text(toml.read_text().replace("adjust = true", "adjust = false"))
    again = stage_forecasts(workspace, settings, only="mapolas", workers=1)["mapolas"]
    assert again.kept > 0
    call("mapolas", workspace.root)
    assert set(made) <= {path.name for path in folder.iterdir()}
    assert len(list(folder.iterdir())) == 6


def test_what_is_up_to_date_takes_nothing(workspace: Workspace) -> None:
    run_stages(workspace, "ingest", "mapolas")
    found = stage_forecasts(workspace, workspace.settings(), only="mapolas")["mapolas"]
    assert found == StageForecast("mapolas")


def squared(number: int) -> int:
    return number**2


def test_a_sample_tells_kept_items_from_others(tmp_path: Path) -> None:
    names = [str(number) for number in range(40)]
    for number in range(40):
        NotingStore(tmp_path, "1").result(squared, number)
    store = NotingStore(tmp_path, "1")
    assert (
        timed_sample(names, lambda name: store.result(squared, int(name)), store, 2).kept_share == 1
    )
    other = NotingStore(tmp_path / "new", "1")
    sample = timed_sample(names, lambda name: other.result(squared, int(name)), other, 2)
    assert sample.kept_share == 0.0
    assert sample.seconds > 0.0
    assert other.count == 6


def test_memory_grows_with_workers_and_the_sum_is_printed() -> None:
    one = StageForecast("fuse", 10, 4, 90.0, 1e8, 1, 5e6, Basis.SAMPLE)
    two = StageForecast("fuse", 10, 4, 45.0, 1e8, 2, 5e6, Basis.SAMPLE)
    assert two.memory_bytes - one.memory_bytes == 1e8
    unknown = StageForecast("scale", seconds=float("nan"), basis=Basis.UNKNOWN, reason="no shape")
    forecasts = {"fuse": one, "scale": unknown, "report": StageForecast("report")}
    lines = list(forecast_lines(forecast_json(forecasts)))
    assert lines[1].split() == ["fuse", "10", "4", "90.0", "s", "360", "5.0", "sample"]
    assert lines[2].endswith("unknown: no shape")
    assert lines[4].split()[:3] == ["all", "90.0", "s"]


def test_info_has_the_keys_and_remembers_them_until_a_file_changes(workspace: Workspace) -> None:
    run_stages(workspace, "ingest")
    # A file that changed within a tick of the clock is not taken for known.
    time.sleep(_TICK_S)
    first = json.loads(call("info", workspace.root, "--json").stdout)
    assert set(first["forecast"]) == set(STAGES)
    assert {"grids", "with_returns", "tiles", "returns", "minutes"} <= set(
        first["mapolas_forecast"]
    )
    # The times are measured: only what is remembered gives the same again.
    assert json.loads(call("info", workspace.root, "--json").stdout) == first
    # So it does for a file that is written again as it was, any number of times ...
    path = workspace.home / "MAPFILES" / "AA0004.MAP"
    content, status = path.read_bytes(), path.stat()
    for _ in range(2):
        path.write_bytes(content)
        time.sleep(_TICK_S)
        assert json.loads(call("info", workspace.root, "--json").stdout) == first
    # ... but not if the content differs, even with the same size and time.
    path.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert json.loads(call("info", workspace.root, "--json").stdout) != first
    (workspace.home / "MAPFILES" / "AA0005.MAP").unlink()
    third = json.loads(call("info", workspace.root, "--json").stdout)
    assert third["maplets"] == 5
    assert third["forecast"]["mapolas"]["items"] == 5


def test_in_a_very_large_workspace_info_looks_only_at_results_that_changed(
    workspace: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fusion.cli.folder._MANY_FILES", 1)
    call("mapolas", workspace.root)
    path = workspace.home / "mapolas" / "AA0004.MAP"
    content = path.read_bytes()
    with monkeypatch.context() as blind:
        # The command has found it out already, and a change shows without looking at the rest.
        blind.delattr("fusion.inspection.workspace_facts.workspace_facts")
        found = info(workspace)
        assert found["stages"]["mapolas"] == "up to date"
        assert found["forecast"] == {}
        assert "spcola run" in call("info", workspace.root).stdout.splitlines()[-1]
        for written in (content[:-1] + bytes([content[-1] ^ 1]), content):
            path.write_bytes(written)
            time.sleep(_TICK_S)
            assert info(workspace) == found | {"stages": states(workspace)}
            assert info(workspace) == found | {"stages": states(workspace)}
            changed = "mapolas/AA0004.MAP has changed" in info(workspace)["stages"]["mapolas"]
            assert changed == (written != content)
    # A maplet may contradict others, and with a file more or less other stages can run.
    maplet = workspace.home / "MAPFILES" / "AA0004.MAP"
    maplet.write_bytes(maplet.read_bytes()[:1000])
    assert any("AA0004" in text for text in info(workspace)["problems"])
    maplet.unlink()
    path.unlink()
    found = info(workspace)
    assert (found["maplets"], found["mapolas"]) == (5, 5)
    assert found["stages"] == states(workspace)


def test_in_a_very_large_workspace_only_a_maplet_that_changed_is_read(
    workspace: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fusion.cli.folder._MANY_FILES", 1)
    call("mapolas", workspace.root)
    path = workspace.maplet_path("AA0004")
    content, read = path.read_bytes(), list[str]()

    def noted(path: Path, **given: Any) -> Any:
        read.append(path.stem)
        return read_map(path, **given)

    monkeypatch.setattr("fusion.pipeline.catalog.maplet_facts.read_map", noted)
    with monkeypatch.context() as blind:
        blind.delattr("fusion.inspection.workspace_facts.workspace_facts")
        found = info(workspace)
        assert found["problems"] == []
        for byte, is_sound in ((len(content) - 1, True), (9, False)):
            flipped = content[:byte] + bytes([content[byte] ^ 1]) + content[byte + 1 :]
            for written in (flipped, content):
                path.write_bytes(written)
                time.sleep(_TICK_S)
                now = info(workspace)
                unsound = [one.text for one in unsound_maplets(workspace)]
                assert now == found | {"stages": states(workspace), "problems": unsound}
                assert info(workspace) == now
                assert (now["stages"]["mapolas"] == "due") == (written != content)
                assert bool(unsound) != (is_sound or written == content)
                # Once by each of the two ways to find it out; all only by that without a memory.
                assert read.count("AA0004") == 2
                assert read.count("AA0001") == 1
                read.clear()


def test_info_after_init_of_a_very_large_workspace_is_known_until_a_file_changes(
    workspace: Workspace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fusion.cli.folder._MANY_FILES", 1)
    made = tmp_path / "made"
    shown = json.loads(call("init", made, "--spc", workspace.home, "--json").stdout)
    there = Workspace.open(made)
    with monkeypatch.context() as blind:
        blind.delattr("fusion.inspection.workspace_facts.workspace_facts")
        first = info(there)
        assert first == shown | {"forecast": {}, "mapolas_forecast": {}}
        assert first["maplets"] == 6
    gone = there.maplet_path("AA0005").rename(tmp_path / "AA0005.MAP")
    assert info(there)["maplets"] == 5
    gone.rename(there.maplet_path("AA0005"))
    time.sleep(_TICK_S)
    assert info(there) == first
    there.maplet_path("AA0006").write_bytes(there.maplet_path("AA0005").read_bytes())
    assert info(there)["maplets"] == 7


def info(workspace: Workspace) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(call("info", workspace.root, "--json").stdout)
    return content


def states(workspace: Workspace) -> dict[str, str]:
    """Return the states of stages as found anew."""
    return Pipeline(workspace, workspace.settings(), load_stages()).states()


def test_what_is_remembered_depends_on_files_outside_and_on_its_own_digest(tmp_path: Path) -> None:
    folder, outside = tmp_path / "ws", tmp_path / "scan.csv"
    (folder / "provenance").mkdir(parents=True)
    (folder / "a.txt").write_text("a")
    outside.write_text("1, 2")
    kept = Remembered(folder)
    assert kept.find(kept.listing()) is None
    kept.keep(seen_later(kept), {"number": 3}, [outside])
    assert kept.find(kept.listing()) == {"number": 3}
    outside.write_text("1, 2, 3")
    assert kept.find(kept.listing()) is None
    kept.keep(seen_later(kept), {"number": 3}, [outside])
    (path,) = folder.glob("provenance/.info")
    path.write_text(path.read_text().replace('"number": 3', '"number": 4'))
    assert kept.find(kept.listing()) is None
    # A file that changed while it was looked at is not taken for the one that was seen.
    before = seen_later(kept)
    (folder / "a.txt").write_text("other")
    kept.keep(before, {"number": 5}, [])
    assert kept.find(kept.listing()) is None
    # Nor one that changed just before: a further change may not show.
    kept.keep(kept.listing(), {"number": 6}, [])
    assert kept.find(kept.listing()) is None


def seen_later(kept: Remembered) -> Listing:
    """Return the files as they are, as if they were listed three seconds later."""
    now = kept.listing()
    return now._replace(begun_ns=now.begun_ns + 3_000_000_000)


def test_options_without_a_forecast_are_refused(workspace: Workspace) -> None:
    assert "--within" in call(
        "run", workspace.root, "--forecast", "--within", "0,0,10", code=2
    ).stderr  # fmt: skip
