"""The whole program from end to end, on the smallest synthetic mission."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from fusion.demo import Demonstration, demonstrate, recovery_table
from fusion.executor import ThreadExecutor
from fusion.progress import Progress
from fusion.truth.planted import MissionSettings
from spcola.errors import WorkspaceError


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Demonstration:
    """The demonstration of the mission for tests; read, never changed."""
    folder = tmp_path_factory.mktemp("demo") / "a folder"
    return demonstrate(folder, ThreadExecutor(2), Progress(), settings=MissionSettings.tiny())


def test_every_stage_ran(shown: Demonstration) -> None:
    assert {run.state for run in shown.runs} == {"ran"}


def test_what_was_planted_is_recovered_within_its_sigma(shown: Demonstration) -> None:
    rows = {row.name: row for row in shown.recovered}
    assert {"registration scale", "epsilon", "prime meridian"} <= set(rows)
    pulls = {name: row.pull for name, row in rows.items()}
    assert all(math.isfinite(pull) for pull in pulls.values()), pulls
    assert max(map(abs, pulls.values())) < 4.0, pulls


def test_the_report_stands_alone(shown: Demonstration) -> None:
    page = shown.workspace.report_path.read_text(encoding="utf-8")
    assert "<html" in page
    assert 'src="http' not in page
    assert 'href="http' not in page


def test_every_output_is_accounted_for(shown: Demonstration) -> None:
    root = shown.workspace.root
    made = set()
    for record in (root / "provenance").glob("*.json"):
        made |= set(json.loads(record.read_text(encoding="utf-8"))["outputs"])
    for folder in ("scans", "mapolas", "fused", "bigmaps", "pairs", "release"):
        found = [path for path in (root / folder).rglob("*") if path.is_file()]
        files = {path.relative_to(root).as_posix() for path in found}
        assert files
        assert files <= made, folder
    assert not list(root.rglob("*.part"))


def test_the_second_time_nothing_is_made_again(shown: Demonstration) -> None:
    again = demonstrate(
        shown.workspace.root.parent,
        ThreadExecutor(2),
        Progress(),
        settings=MissionSettings.tiny(),
    )
    assert {run.state for run in again.runs} == {"up to date"}
    assert again.recovered == shown.recovered


def test_the_table_puts_planted_beside_recovered(shown: Demonstration) -> None:
    head, *lines = recovery_table(shown.recovered)
    assert head.split() == ["planted", "recovered", "sigma", "off", "by"]
    assert len(lines) == len(shown.recovered)
    assert any(line.startswith("epsilon") and "σ" in line for line in lines)


def test_a_folder_of_other_things_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "letters").mkdir()
    with pytest.raises(WorkspaceError, match="other things"):
        demonstrate(tmp_path, ThreadExecutor(1), Progress())
    assert [path.name for path in tmp_path.iterdir()] == ["letters"]
