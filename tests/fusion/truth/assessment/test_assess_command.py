"""``spcola truth assess`` over a tiny mission: its own solution, and models made of the truth."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import app
from typer.testing import CliRunner

from fusion.truth import make_mission, read_truth
from fusion.truth.assessment import AssessmentSettings
from fusion.truth.assessment.definitions import definitions
from fusion.truth.assessment.pictures import error_map
from fusion.truth.assessment.regions import PointErrors
from fusion.truth.planted import Planted
from fusion.workspace import new_workspace
from spcola.formats.maplets import read_maplet, write_maplet
from spcola.formats.shapes import write_icq
from spcola.shape.icq import IcqShape
from spcola.truth.solution import heights_in_frame

# Known by their names or by the entries around them.
SELF_EXPLAINED = {
    "name", "frame", "gsd_m", "patches_there", "icp", "regions", "spectra", "resolution_reason",
    "points",
}  # fmt: skip


@pytest.fixture(scope="module")
def mission(tmp_path_factory, one_scan) -> tuple[Path, Planted]:
    """A mission of one scan, which has a whole SPC solution nevertheless."""
    folder = tmp_path_factory.mktemp("assess")
    make_mission(folder / "mission", settings=one_scan)
    new_workspace(folder / "WS", body="Truth", spc=folder / "mission" / "spc")
    return folder, read_truth(folder / "mission")


def run(folder: Path, *options: object) -> dict[str, Any]:
    words = ["truth", "assess", folder / "WS", "--truth", folder / "mission", *options, "--json"]
    words += ["--vertices", 2000]
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


@pytest.fixture(scope="module")
def found(mission) -> tuple[dict[str, Any], str]:
    folder = mission[0]
    content = run(folder, "--report", folder / "page.html")
    return content, (folder / "page.html").read_text(encoding="utf-8")


def test_the_solution_is_as_wrong_as_it_was_made(found) -> None:
    models = {model["name"]: model for model in found[0]["models"]}
    assert set(models) == {"SPC maplets", "shape"}
    maplets = models["SPC maplets"]
    # Noise of 10 cm, centres of 6 cm, and what smoothing takes off edges.
    assert 0.08 < maplets["regions"]["lit"]["robust_std_m"] < 0.20
    assert maplets["rms_3d_optimised_m"] <= maplets["rms_3d_without_offset_m"] + 1e-4
    assert maplets["rms_3d_without_offset_m"] < maplets["rms_3d_m"]
    assert maplets["icp"]["converged"]
    regions = maplets["regions"]
    assert regions["all"]["points"] == regions["lit"]["points"] + regions["shadowed"]["points"]
    assert regions["boulders"]["rms_m"] > regions["other ground"]["rms_m"]
    assert 0.5 < regions["lit"]["within_1_sigma"] < 0.85
    assert maplets["resolution_m"] > 3.0 * maplets["gsd_m"]


def test_the_offset_of_the_shape_is_the_planted_translation(mission, found) -> None:
    shape = found[0]["models"][-1]
    np.testing.assert_allclose(
        shape["center_of_figure_offset_m"], mission[1].settings.translation_m, atol=0.02
    )


def test_formu_is_what_the_landmarks_were_measured_with(mission, found) -> None:
    formal = found[0]["formal_uncertainty"]
    sigma = mission[1].settings.states.pixel_sigma
    assert formal["observations"] > 10
    # Two components of the planted noise; displaced states and centres come to it.
    assert formal["residual_pixels"] > np.sqrt(2.0) * sigma * 0.8
    assert formal["formu_m"] > 0
    maplets = found[0]["models"][0]
    assert maplets["formu_ratio"] == pytest.approx(
        formal["formu_m"] / maplets["rms_3d_optimised_m"]
    )


def test_every_figure_is_defined(found) -> None:
    content = found[0]
    known = set(content["definitions"])
    keys = set()
    for model in content["models"]:
        keys |= set(model) | {key for region in model["regions"].values() for key in region}
        assert {name for name in model["regions"] if "latitude" not in name} - {"all"} <= known
    undefined = {key for key in keys - known - SELF_EXPLAINED if not key.endswith(SIGMAS)}
    assert not undefined
    assert all(len(text) > 8 for text in content["definitions"].values())


SIGMAS = ("offset_sigma_m", "translation_sigma_m", "rotation_sigma_deg")


def test_the_page_needs_nothing_else(found) -> None:
    content, page = found
    assert not re.search(r"(?:src|href)=\"(?!data:|#)", page)
    assert page.count("<figure>") == 4 + 2 * len(content["models"])
    for key in definitions(AssessmentSettings()):
        assert key in page
    assert "<td>nan</td>" not in page


def test_a_perfect_maplet_scores_zero_and_a_raised_one_10_cm(mission) -> None:
    folder, planted = mission
    paths = sorted((folder / "mission" / "spc" / "MAPFILES").glob("*.MAP"))
    spc = read_maplet(paths[len(paths) // 2])
    truth = heights_in_frame(planted.body(), spc.grid, planted.similarity)
    for name, rise in (("PERFECT", 0.0), ("RAISED", 0.1)):
        maplet = spc.with_layers(name=name, height=truth + rise)
        write_maplet(folder / f"{name}.MAP", maplet)
    options = [x for name in ("PERFECT", "RAISED") for x in ("--model", folder / f"{name}.MAP")]
    perfect, raised = run(folder, "--only", *options)["models"]
    # A .MAP holds heights to some tenths of a millimetre.
    assert perfect["regions"]["all"]["rms_m"] < 1e-3
    assert raised["regions"]["all"]["mean_m"] == pytest.approx(0.1, abs=1e-3)
    assert raised["regions"]["all"]["rms_m"] == pytest.approx(0.1, abs=1e-3)


def test_shapes_score_their_rise_their_offset_and_their_scale(mission) -> None:
    folder, planted = mission
    body = planted.body()
    exact = body.icq(24)
    shift = np.array([0.06, -0.08, 0.0])
    made = {
        "exact": exact.vertices,
        "moved": exact.vertices + shift,
        "scaled": 1.0005 * exact.vertices,
    }
    options: list[object] = ["--frame", "body", "--only"]
    for name, vertices in made.items():
        write_icq(folder / f"{name}.txt", IcqShape(vertices), digits=7)
        options += ["--model", folder / f"{name}.txt"]
    exact_model, moved, scaled = run(folder, *options)["models"]
    assert exact_model["rms_3d_m"] < 1e-4
    assert moved["rms_3d_m"] == pytest.approx(0.1 / np.sqrt(3.0), rel=0.15)
    np.testing.assert_allclose(moved["center_offset_m"], shift, atol=1e-4)
    assert moved["rms_3d_without_offset_m"] < 1e-4
    assert moved["rms_3d_optimised_m"] < 1e-4
    for key in ("rms_3d_m", "rms_3d_without_offset_m", "rms_3d_optimised_m"):
        assert scaled[key] == pytest.approx(0.0005 * 40.0, rel=0.1)


def test_wrong_usage_is_reported(mission) -> None:
    folder = mission[0]
    words = ["truth", "assess", str(folder / "WS"), "--truth"]
    result = CliRunner().invoke(app, [*words, str(folder / "mission"), "--only"])
    assert result.exit_code == 2
    result = CliRunner().invoke(app, [*words, str(folder / "WS")])
    assert result.exit_code == 1
    assert "truth.json" in result.stderr


def test_the_map_of_errors_is_the_mean_of_each_cell() -> None:
    direction = np.array([[1.0, 0.0, 0.01], [1.0, 0.001, 0.01], [0.0, 0.0, 1.0], [0.0, -1.0, -1.0]])
    height = np.array([0.1, 0.3, 0.5, -1.0])
    empty = np.full(4, np.nan)
    mean = error_map(PointErrors(height, empty, empty, direction, np.ones(4, np.uint16)), 10.0)
    assert mean.shape == (18, 36)
    assert mean[9, 0] == pytest.approx(0.2)
    assert mean[17, 0] == pytest.approx(0.5)
    assert mean[4, 27] == pytest.approx(-1.0)
    assert np.count_nonzero(np.isfinite(mean)) == 3
