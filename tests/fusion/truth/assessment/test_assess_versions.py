"""``spcola truth assess --solution``: a curve over versions of planted quality."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from command_line import app
from typer.testing import CliRunner

from fusion.pipeline.solutions import MadeBy, making_solution
from fusion.truth import make_mission, read_truth
from fusion.truth.assessment.frame import planted_in
from fusion.truth.planted import Planted
from fusion.workspace import Workspace, new_workspace
from spcola.control import scaled
from spcola.formats.maplets import write_maplet
from spcola.truth.solution import heights_in_frame

EPSILON = 0.002


@pytest.fixture(scope="module")
def mission(tmp_path_factory, one_scan) -> tuple[Path, Planted]:
    """A mission with three versions: the planted one, the true heights, and both too large."""
    folder = tmp_path_factory.mktemp("versions")
    make_mission(folder / "mission", settings=one_scan)
    planted = read_truth(folder / "mission")
    imported = new_workspace(folder / "WS", body="Truth", spc=folder / "mission" / "spc")
    body = planted.body()
    with making_solution(imported, "true", MadeBy("a test", {}, {}, {})) as making:
        for name in imported.maplet_names()[:-2]:
            maplet = imported.maplet(name)
            height = heights_in_frame(body, maplet.grid, planted.similarity)
            path = making / "MAPFILES" / f"{name}.MAP"
            write_maplet(path, maplet.with_layers(height=height))
    true = replace(imported, solution="true")
    by_scale = MadeBy("spcola scale --apply", {}, {"epsilon": EPSILON}, {})
    with making_solution(true, "larger", by_scale) as making:
        for name in true.maplet_names():
            path = making / "MAPFILES" / f"{name}.MAP"
            write_maplet(path, scaled(true.maplet(name), 1.0 + EPSILON))
    return folder, planted


def run(folder: Path, solution: str, *options: object, code: int = 0) -> Any:
    words = ["truth", "assess", folder / "WS", "--truth", folder / "mission"]
    words += ["--vertices", 1000, "--patches", 12, "--solution", solution, *options]
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == code, result.output
    return result


def found(folder: Path, solution: str, *options: object) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(run(folder, solution, "--json", *options).stdout)
    return content


@pytest.fixture(scope="module")
def curve(mission) -> list[dict[str, Any]]:
    content = found(mission[0], "all", "--report", mission[0] / "curve.html")
    return content["solutions"]


@pytest.mark.parametrize("place", [0, 1, 2])
def test_the_curve_has_what_each_solution_has_alone(mission, curve, place: int) -> None:
    version = curve[place]
    alone = found(mission[0], version["solution"])
    assert version["models"] == alone["models"]
    assert version["formal_uncertainty"] == alone["formal_uncertainty"]


def test_the_curve_shows_the_planted_quality(curve) -> None:
    assert [one["solution"] for one in curve] == ["imported", "true", "larger"]
    assert [one["parent"] for one in curve] == [None, "imported", "true"]
    imported, true, larger = (one["models"][0] for one in curve)
    assert true["rms_3d_optimised_m"] < 0.8 * imported["rms_3d_optimised_m"]
    # A sphere that is too large by ε lies ε R outside, whatever its rotation and translation.
    assert larger["rms_3d_optimised_m"] > 0.5 * EPSILON * 40.0
    assert [one["effort"]["changed"] and one["effort"]["changed"]["maplets"] for one in curve] == [
        None, 10, 12,
    ]  # fmt: skip


def test_effort_is_what_was_recorded(curve) -> None:
    imported, true, larger = (one["effort"] for one in curve)
    assert (imported["items"], imported["processor_s"]) == (None, None)
    assert (true["items"], larger["items"]) == (10, 12)
    assert true["processor_s"] > 0.0


def test_heights_of_a_scaled_solution_are_compared_in_its_own_frame(curve) -> None:
    _, true, larger = (one["models"][0]["regions"]["all"] for one in curve)
    assert larger["rms_m"] == pytest.approx(true["rms_m"], rel=0.02)
    assert larger["mean_m"] == pytest.approx(true["mean_m"], abs=2e-3)


def test_planted_values_follow_the_scale_of_a_solution(mission) -> None:
    folder, planted = mission
    moved = planted_in(planted, Workspace.open(folder / "WS", "larger"))
    point = [30.0, -10.0, 20.0]
    expected = (1.0 + EPSILON) * planted.similarity.apply(point)
    assert moved.similarity.apply(point) == pytest.approx(expected, abs=1e-9)
    assert planted_in(planted, Workspace.open(folder / "WS", "true")) is planted


def test_the_page_and_the_lines_list_every_version(mission, curve) -> None:
    folder = mission[0]
    page = (folder / "curve.html").read_text(encoding="utf-8")
    assert page.count("<figure>") == 1
    lines = run(folder, "all").stdout.splitlines()
    for one in curve:
        assert one["solution"] in page
        rms = f"{one['models'][0]['rms_3d_m']:.3f}"
        assert any(line.startswith(one["solution"]) and rms in line for line in lines)


def test_wrong_usage_is_refused(mission) -> None:
    folder = mission[0]
    run(folder, "all", "--model", folder / "WS", code=2)
    assert "there is no solution" in run(folder, "absent", code=1).stderr
