"""The whole program from end to end, on the smallest synthetic mission."""

from __future__ import annotations

import json
import math
import re
import shutil
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import app
from distributed import LocalCluster
from typer.testing import CliRunner

from fusion.fusing import fuse_maplet
from fusion.fusing.maplets import Source
from fusion.fusing.uncertainty import DEFAULT_INFORMATION, ImageSlopes, estimate_information
from fusion.pipeline import Pipeline
from fusion.runtime import ClusterExecutor, Progress, ThreadExecutor
from fusion.scene import Scene, read_registration
from fusion.stages import load_stages
from fusion.truth import demonstrate, errors_table, read_truth, recovery_table
from fusion.truth.causes import explained
from fusion.truth.demo import Demonstration
from fusion.truth.presets import MissionSettings
from fusion.truth.surface_errors import surface_errors
from fusion.workspace import Workspace
from spcola.errors import WorkspaceError
from spcola.truth.solution import heights_in_frame


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


def test_ground_that_no_image_shows_lit_is_given_to_the_lidar(shown: Demonstration) -> None:
    """The Sun high over the north pole: the southernmost maplet has no slopes from images."""
    scene = Scene.of(shown.workspace, light="none")
    states = shown.workspace.images()
    azimuth = np.linspace(0.0, 2.0 * np.pi, len(states))
    suns = np.stack(
        [0.5 * np.cos(azimuth), 0.5 * np.sin(azimuth), np.full_like(azimuth, 0.75**0.5)], 1
    )
    images = tuple(replace(state, sun=sun) for state, sun in zip(states, suns, strict=True))
    polar = replace(scene, illumination=ImageSlopes(images, "sun"))
    south, north = (
        pick(scene.grids, key=lambda name: scene.grids[name].uz[2]) for pick in (min, max)
    )
    assert np.mean(polar.parts(north).spc.valid) > 0.8
    dark, bright = polar.parts(south), scene.parts(south)
    assert not dark.spc.valid.any()
    filled_in = bright.spc.valid
    assert filled_in.any()
    np.testing.assert_array_equal(dark.prior, scene.prior(dark.grid))
    fused = fuse_maplet(dark, DEFAULT_INFORMATION).maplet
    measured = np.isfinite(dark.lidar.height)
    assert (fused.source[measured] == Source.LIDAR).all()
    unmeasured = ~measured & fused.valid
    assert (fused.source[unmeasured] == Source.FILLED).all()
    # It gives nothing of SPC's slopes, but what the shape is worth in the dark.
    pair = polar.comparison(south)
    assert pair is not None
    assert np.isnan(pair.spc).all()
    found = estimate_information([pair])
    assert found.shape is not None
    assert replace(found, shape=None) == DEFAULT_INFORMATION
    # Without a shape what SPC filled in stands for it.
    shapeless = replace(polar, prior=lambda grid: np.full(grid.shape, np.nan)).parts(south)
    np.testing.assert_array_equal(shapeless.prior[filled_in], bright.spc.height[filled_in])


def test_a_notebook_registers_and_fuses_as_the_stages_do(shown: Demonstration) -> None:
    workspace = shown.workspace
    scene = Scene.of(workspace)
    name = scene.targets[0]
    fused = workspace.fused(name)
    np.testing.assert_array_equal(scene.fuse(name).maplet.height, fused.height)
    known = read_registration(workspace)
    center = workspace.mapola(name).grid.center
    registered = known.transform.apply(center) + scene.placements[name].shift
    np.testing.assert_allclose(registered, scene.mapola_grids[name].center, rtol=0, atol=1e-12)
    sigma = workspace.read_json("registration.json")["translation_sigma_m"]
    origin = known.position_covariance(np.zeros((1, 3)))[0]
    np.testing.assert_allclose(np.sqrt(np.diag(origin)), sigma, rtol=1e-6)


def test_every_model_of_the_workspace_is_compared_with_the_truth(shown: Demonstration) -> None:
    root = shown.workspace.root
    words = ["truth", "assess", root, "--truth", root.parent / "mission", "--vertices", 500]
    result = CliRunner().invoke(app, [*map(str, words), "--json"])
    assert result.exit_code == 0, result.output
    content = json.loads(result.stdout)
    models = {model["name"]: model for model in content["models"]}
    assert len(models) == 7
    spc, fused = models["SPC maplets"], models["fused maplets"]
    assert fused["regions"]["all"]["rms_m"] < 0.7 * spc["regions"]["all"]["rms_m"]
    assert fused["resolution_m"] < spc["resolution_m"]
    assert models["mapolas, registered"]["rms_3d_optimised_m"] < spc["rms_3d_optimised_m"]
    assert [row["name"] for row in content["recovered"]] == [row.name for row in shown.recovered]


def test_errors_of_the_three_surfaces_are_those_of_their_heights(shown: Demonstration) -> None:
    spc, lidar, fused = shown.errors
    assert [spc.name, lidar.name, fused.name] == ["SPC", "lidar", "fused"]
    assert lidar.share < fused.share
    assert fused.rms_m < 0.7 * spc.rms_m
    assert 0 < fused.within_68_m < fused.within_95_m
    planted = read_truth(shown.workspace.root.parent / "mission")
    grid = shown.workspace.maplet(shown.workspace.maplet_names()[0]).grid
    truth = heights_in_frame(planted.body(), grid, planted.similarity)
    unknown = np.full(grid.shape, np.nan)
    heights = {"true": truth, "raised": truth + 0.3, "none": unknown}
    true, raised, none = surface_errors(planted, [(grid, heights)])
    assert true.rms_m == 0.0
    assert true.share == pytest.approx(np.isfinite(truth).mean())
    assert (raised.rms_m, raised.within_68_m) == (pytest.approx(0.3), pytest.approx(0.3))
    assert none.share == 0.0
    assert np.isnan(none.rms_m)
    head, *lines = errors_table(shown.errors)
    assert "95 % below" in head
    assert [line.split()[0] for line in lines] == ["SPC", "lidar", "fused"]


def test_the_report_of_a_demo_shows_sources_errors_and_a_gap(shown: Demonstration) -> None:
    page = shown.workspace.report_path.read_text(encoding="utf-8")
    for wanted in ("What the surface rests on", "95 % below", "what the fused heights rest on"):
        assert wanted in page, wanted
    content = shown.as_dict()
    assert [row["name"] for row in content["errors"]] == ["SPC", "lidar", "fused"]
    assert {"pull", "explanation"} <= set(content["recovered"][0])


def test_a_cluster_makes_the_same_bytes(shown: Demonstration, tmp_path: Path) -> None:
    root = shown.workspace.root
    other = tmp_path / "other"
    shutil.copytree(root, other, symlinks=True)
    workspace = Workspace.open(other)
    # Drawing the report is no work for a cluster.
    stages = [stage for stage in load_stages() if stage.name != "report"]
    with LocalCluster(n_workers=1, threads_per_worker=2, dashboard_address=":0") as cluster:
        executor = ClusterExecutor(str(cluster.scheduler_address))
        runs = Pipeline(workspace, workspace.settings(), stages, executor).run(force=True)
        executor.close()
    assert {run.state for run in runs} == {"ran"}
    made = [path for path in root.rglob("*") if path.is_file() and not path.is_symlink()]
    # Records say when a stage ran, the manifest and the report when a release was made.
    timed = ("provenance", "catalog.sqlite", "manifest.json", "report.html", ".lock")
    compared = 0
    for path in made:
        name = path.relative_to(root)
        if name.parts[0] in timed or name.name in timed:
            continue
        assert (other / name).read_bytes() == path.read_bytes(), name
        compared += 1
    assert compared > 100


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


def test_the_table_has_planted_and_recovered_values(shown: Demonstration) -> None:
    head, *lines, last = recovery_table([replace(row, explanation="") for row in shown.recovered])
    assert head.split() == ["planted", "recovered", "sigma", "off", "by"]
    assert len(lines) == len(shown.recovered)
    assert any(line.startswith("epsilon") and "σ" in line for line in lines)
    assert last == "beyond 3 σ: none"


def test_a_line_explains_each_parameter_beyond_three_sigma(shown: Demonstration) -> None:
    """Of the same mission with sigmas that are far too small."""
    planted = read_truth(shown.workspace.root.parent / "mission")
    rows = [replace(row, sigma=row.sigma / 1e3, explanation="") for row in shown.recovered]
    scale = shown.workspace.read_json("scale.json")
    found = explained(rows, planted, shown.workspace, scale)
    large = [row for row in found if abs(row.pull) > 3.0]
    assert len(large) > 10
    assert all((row.explanation != "") == (row in large) for row in found)
    lines = list(recovery_table(found))
    assert lines[-len(large) - 1] == f"beyond 3 σ: {len(large)}"
    by_name = {row.name: row.explanation for row in large}
    assert "planted errors of the maplets' centres" in by_name["registration translation x"]
    assert "planted errors of SPC's camera positions" in by_name["centre offset y"]
    assert "by chance one mission in" in lines[-1]


@pytest.fixture(scope="module")
def copied(shown: Demonstration, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The finished workspace, to be changed."""
    root = tmp_path_factory.mktemp("copy") / "WS"
    shutil.copytree(shown.workspace.root, root, symlinks=True)
    return root


def command(*arguments: object) -> dict[str, Any]:
    result = CliRunner().invoke(app, [*map(str, arguments), "--json"])
    assert result.exit_code == 0, result.output
    summary: dict[str, Any] = json.loads(result.stdout)["summary"]
    return summary


# Each model and each surface; all pairs of them are slow.
QUICK = {
    ("rigid", "bigmap"),
    ("similarity", "maplets"),
    ("similarity", "shape"),
    ("affine", "shape"),
}


@pytest.mark.parametrize(
    ("model", "against"),
    [
        pytest.param(*pair, marks=() if pair in QUICK else pytest.mark.slow)
        for pair in product(("rigid", "similarity", "affine"), ("maplets", "bigmap", "shape"))
    ],
)
def test_mapolas_are_registered_by_every_model_against_every_surface(
    shown: Demonstration, copied: Path, model: str, against: str
) -> None:
    summary = command("register", copied, "--model", model, "--against", against)
    planted = {row.name: row.planted for row in shown.recovered}
    content = json.loads((copied / "registration.json").read_text(encoding="utf-8"))
    assert len(content["covariance"]) == {"rigid": 6, "similarity": 7, "affine": 12}[model]
    assert summary["n_used"] >= 18
    for axis, letter in enumerate("xyz"):
        error = summary["translation_m"][axis] - planted[f"registration translation {letter}"]
        assert abs(error) < 4.0 * summary["translation_sigma_m"][axis]
    if model != "rigid":
        error = summary["scale"] - planted["registration scale"]
        assert abs(error) < 4.0 * summary["scale_sigma"]
    scale_per_m = [
        entry["scale_per_m"] for entry in content["per_mapola"] if "scale_per_m" in entry
    ]
    assert bool(scale_per_m) == (model == "similarity" and against != "shape")
    if scale_per_m:
        # A body that is larger all over has that much more scale, one that is moved has not.
        centers = np.array([entry["center_m"] for entry in content["per_mapola"]])
        assert np.sum(scale_per_m * centers) == pytest.approx(1.0, abs=1e-3)
        assert np.all(np.abs(np.sum(scale_per_m, axis=0)) < 1e-9)


def test_returns_themselves_are_registered_like_their_mapolas(
    shown: Demonstration, copied: Path
) -> None:
    by_mapolas = json.loads((copied / "registration.json").read_text(encoding="utf-8"))
    summary = command("register", copied, "--by", "returns")
    planted = {row.name: row.planted for row in shown.recovered}
    error = summary["scale"] - planted["registration scale"]
    assert abs(error) < 4.0 * summary["scale_sigma"]
    apart = abs(summary["scale"] - by_mapolas["scale"])
    # The same returns, but matches that weigh wavelengths otherwise, and gaps.
    assert apart < 2.0 * np.hypot(summary["scale_sigma"], by_mapolas["scale_sigma"])
    content = json.loads((copied / "registration.json").read_text(encoding="utf-8"))
    observable = [scan for scan in content["per_scan_fit"] if not scan["reason"]]
    assert len(observable) > len(content["per_scan_fit"]) / 2
    pulls = [np.divide(scan["offset_m"], scan["offset_sigma_m"]) for scan in observable]
    assert np.sqrt(np.mean(np.square(pulls))) < 2.0


def test_single_shots_give_the_same_scale(shown: Demonstration, copied: Path) -> None:
    settings = copied / "spcola.toml"
    text = settings.read_text(encoding="utf-8")
    settings.write_text(re.sub(r"max_shots = \d+", "max_shots = 1500", text), encoding="utf-8")
    summary = command("scale", copied, "--method", "shots")
    planted = {row.name: row.planted for row in shown.recovered}
    assert abs(summary["epsilon"] - planted["epsilon"]) < 4.0 * summary["epsilon_sigma"]
    meridian = summary["prime_meridian_deg"] - planted["prime meridian"]
    assert abs(meridian) < 4.0 * summary["prime_meridian_sigma_deg"]
    # SPC's heights err by 11 cm, over some metres; the shots are denser than that.
    assert 0.5 < summary["ground_reach_m"] < 10.0
    assert 0.03 < summary["ground_sigma_m"] < 0.5


def test_images_that_match_nowhere_give_no_scale_but_a_reason(copied: Path) -> None:
    settings = copied / "spcola.toml"
    text = settings.read_text(encoding="utf-8")
    settings.write_text(re.sub(r"capture_m = 5\.0", "capture_m = 0.01", text), encoding="utf-8")
    result = CliRunner().invoke(app, ["scale", str(copied), "--json"])
    assert result.exit_code == 1
    assert "[scale-not-observed]" in result.stderr
    summary = json.loads(result.stdout)["summary"]
    assert summary["epsilon"] is None
    assert "nothing is observed" in summary["reasons"][0]
    ran = json.loads(CliRunner().invoke(app, ["run", str(copied), "--json"]).stdout)
    assert {stage["state"] for stage in ran["stages"]} <= {"ran", "up to date"}
    assert (copied / "report.html").is_file()


def test_a_folder_of_other_things_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "letters").mkdir()
    with pytest.raises(WorkspaceError, match="other things"):
        demonstrate(tmp_path, ThreadExecutor(1), Progress())
    assert [path.name for path in tmp_path.iterdir()] == ["letters"]
