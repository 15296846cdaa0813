"""Registration by images through the real commands, on a small mission with images."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from fusion.cli.app import app
from fusion.executor import ThreadExecutor
from fusion.progress import Progress
from fusion.truth.mission import make_mission
from fusion.truth.presets import MissionSettings
from spcola.truth.campaign import CampaignSettings


def run(*arguments, code=0):
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == code, result.output
    return result.output


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    """A workspace with mapolas and images of 128² pixels; tests set how it is registered."""
    folder = tmp_path_factory.mktemp("images")
    tiny = MissionSettings.tiny()
    settings = replace(
        tiny, images=True, image_formats=("dat",),
        campaign=CampaignSettings(radius=tiny.body.radius, detector=128),
    )  # fmt: skip
    mission = folder / "mission"
    make_mission(mission, settings=settings, executor=ThreadExecutor(2), progress=Progress())
    run("init", folder / "WS", "--spc", mission / "spc")
    run("import", folder / "WS", *sorted((mission / "lidar").iterdir()))
    run("mapolas", folder / "WS")
    return folder / "WS", settings


def registered(workspace, **keys):
    path = workspace / "spcola.toml"
    lines = path.read_text().splitlines()
    start = lines.index("[register]")
    for key, value in keys.items():
        row = next(k for k in range(start, len(lines)) if lines[k].startswith(f"{key} ="))
        lines[row] = f"{key} = {json.dumps(value)}"
    path.write_text("\n".join(lines) + "\n")
    summary = json.loads(run("register", workspace, "--json"))["summary"]
    return summary, json.loads((workspace / "registration.json").read_text())


@pytest.fixture(scope="module")
def found(workspace):
    """What each kind makes of the workspace: the summary of the stage and the registration."""
    return {by: registered(workspace[0], by=by) for by in ("topography", "images", "both")}


def test_what_was_planted_is_recovered_by_images(workspace, found):
    _, settings = workspace
    summary, content = found["images"]
    assert content["by"] == summary["by"] == "images"
    assert content["n_images"] > 10
    truth = settings.to_spc
    turned = np.degrees(truth.rotation_vector) - content["rotation_deg"]
    assert np.all(np.abs(turned) < 4.0 * np.array(content["rotation_sigma_deg"]))
    assert abs(content["scale"] - truth.scale) < 4.0 * content["scale_sigma"]
    assert max(content["rotation_sigma_deg"]) < 0.035
    assert content["maplet_sigma_m"] is None
    for entry in content["per_mapola"]:
        assert entry["n_images"] > 1 or entry["reason"]
        assert all(isinstance(count, int) for count in entry["images_left_out"].values())
        if entry["used"]:
            assert len(entry["surface_residual_m"]) == 3


def test_both_kinds_together_are_as_sharp_as_either(found):
    content = found["both"][1]
    assert content["scale_sigma"] <= found["topography"][1]["scale_sigma"]
    turned = [np.array(found[by][1]["rotation_sigma_deg"]) for by in ("both", "images")]
    assert np.all(turned[0] <= 1.02 * turned[1])
    assert content["n_used"] + content["n_rejected"] == len(content["per_mapola"]) == 24
    told = [e["kinds_chi2"] for e in content["per_mapola"] if e["kinds_chi2"] is not None]
    assert len(told) > 15
    assert 1.0 < np.mean(told) < 6.0
    for entry in content["per_mapola"]:
        kinds = entry["kinds"]
        assert entry["used"] == (kinds["topography"]["used"] or kinds["images"]["used"])
        if kinds["topography"]["used"] and kinds["images"]["used"]:
            sigmas = np.array([kinds[kind]["sigma_m"] for kind in kinds])
            assert np.all(np.array(entry["sigma_m"]) < sigmas.max(axis=0))
    # What images make of the scale leans on states, of which no file tells.
    assert all("scale_per_m" not in entry for entry in content["per_mapola"])
    # A mapola that images hardly place must not make the mission look bad.
    left = np.std([entry["residual_m"] for entry in content["per_mapola"] if entry["used"]], axis=0)
    np.testing.assert_allclose(content["residual_std_m"], left)


def test_the_default_is_topography_and_a_wrong_function_is_refused(workspace, found):
    _, content = found["topography"]
    assert content["by"] == "topography"
    assert "n_images" not in content
    path = workspace[0] / "spcola.toml"
    text = path.read_text().replace('by = "both"', 'by = "images"')
    path.write_text(text.replace('"lunar-lambert"', '"moonish"'))
    assert "'moonish' is none of" in run("register", workspace[0], code=1)
    path.write_text(text)
