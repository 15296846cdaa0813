from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
from command_line import app, call, called
from typer.testing import CliRunner

from fusion.scaling.results.keys import SCALE_KEYS


@pytest.fixture(scope="module")
def ryugu(shared_data, tmp_path_factory):
    """A workspace with Ryugu's shape and shots, by the real commands."""
    folder = tmp_path_factory.mktemp("ryugu") / "WS"
    data = shared_data / "ryugu"
    call("init", folder, "--shape", data / "ryugu_sfm_v20180804_decimated.obj", "--body", "Ryugu")
    call("import", folder, data / "hyb2_ldr_l2_aocsm_topo_ts_20180701_odd_rows.csv")
    return folder


@pytest.mark.real_data
def test_ryugu_shots_through_the_command_line(ryugu):
    summary = called("scale", ryugu, "--method", "shots")["summary"]
    content = json.loads((ryugu / "scale.json").read_text())
    assert content["epsilon"] == summary["epsilon"]
    assert len(content["per_shot"]) == 26
    keys = {*content, *(f"per_shot.{key}" for key in content["per_shot"][0])}
    assert keys <= set(SCALE_KEYS)
    assert content["assumed"]["footprint_mrad"] is None
    assert content["assumed"]["pointing_sigma_mrad"] is None
    residuals = [shot["residual_m"] for shot in content["per_shot"]]
    assert np.mean(residuals) == pytest.approx(-2.8, abs=0.1)
    assert not content["longitude_check"]["misfit"]
    assert content["longitude_check"]["rivals"] == 0
    # One scan: it is no other place that each could have.
    assert content["scan_check"]["per_scan"] == []
    assert content["scan_check"]["between_m"] is None
    assert content["verdict"] == summary["verdict"] == "accepted"
    assert {found["severity"] for found in content["findings"]} == {"note"}
    measured = content["residuals"]["measured_minus_predicted"]
    assert measured["mean_m"] == pytest.approx(-2.8, abs=0.1)
    assert 1.5 < measured["std_m"] < 2.2
    # Far more than a range of 0.1 m lets expect, by the coarse shape: noted, and right.
    assert "scatter-too-large" in {found["code"] for found in content["findings"]}
    assert content["residuals"]["after_fit"]["robust_std_m"] < measured["std_m"]
    # One day, one side: the size is not observable, with a reason.
    assert content["trajectory"] == "reference"
    assert any(reason.startswith("epsilon: not determined") for reason in content["reasons"])
    assert abs(content["epsilon"]) < 2 * content["epsilon_sigma"]
    assert all(sigma > 0.5 for sigma in content["center_offset_sigma_m"])
    # Shots 8 m apart do not err alike on facets of some 20 m.
    assert content["ground_sigma_m"] is None
    assert content["ground_reach_m"] is None


@pytest.mark.real_data
def test_ryugu_shots_with_a_footprint_and_pointing(ryugu, tmp_path):
    workspace = tmp_path / "WS"
    shutil.copytree(ryugu, workspace)
    settings = workspace / "spcola.toml"
    text = settings.read_text().replace("footprint_mrad = 0.0", "footprint_mrad = 1.5")
    text = text.replace("pointing_sigma_mrad = 0.0", "pointing_sigma_mrad = 0.5")
    settings.write_text(text)
    call("scale", workspace, "--method", "shots")
    content = json.loads((workspace / "scale.json").read_text())
    assert content["assumed"]["footprint_mrad"] == pytest.approx(1.5)
    assert content["assumed"]["pointing_sigma_mrad"] == pytest.approx(0.5)
    # Ten metres of pointing on slopes of some degrees: more than the 10 cm of a range.
    assert all(shot["sigma_m"] > 0.3 for shot in content["per_shot"])


@pytest.mark.real_data
@pytest.mark.parametrize("turn_deg", [10.0, -10.0, 90.0])
def test_ryugu_turned_is_recognised_as_a_misfit(ryugu, shared_data, tmp_path, turn_deg):
    turned = tmp_path / "turned.csv"
    cosine, sine = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    lines = ["utc,x_m,y_m,z_m,scx_m,scy_m,scz_m"]
    table = shared_data / "ryugu" / "hyb2_ldr_l2_aocsm_topo_ts_20180701_odd_rows.csv"
    for row in table.read_text().splitlines():
        utc, *numbers = row.split(",")
        x, y, z, scx, scy, scz = map(float, numbers[4:])
        places = [
            (x * cosine - y * sine, x * sine + y * cosine, z),
            (scx * cosine - scy * sine, scx * sine + scy * cosine, scz),
        ]
        lines.append(",".join([utc, *(f"{value:.4f}" for place in places for value in place)]))
    turned.write_text("\n".join(lines) + "\n")
    workspace = tmp_path / "WS"
    shutil.copytree(ryugu, workspace)
    for left in ("scans", "provenance"):
        shutil.rmtree(workspace / left)
    (workspace / "catalog.sqlite").unlink()
    (workspace / "scans").mkdir()
    call("import", workspace, turned)
    printed = call("scale", workspace, "--method", "shots", code=1).output
    assert "verdict: refused" in printed
    assert "[shots-fit-elsewhere]" in printed
    content = json.loads((workspace / "scale.json").read_text())
    assert content["verdict"] == "refused"
    check = content["longitude_check"]
    assert check["misfit"]
    assert check["p_value"] < 1e-3
    assert check["p_paired"] < 1e-6
    assert abs((check["best_turn_deg"] + turn_deg + 180.0) % 360.0 - 180.0) <= 2.0
    assert any(reason.startswith("misfit: the shots fit better") for reason in content["reasons"])


@pytest.mark.real_data
def test_an_insignificant_epsilon_is_not_applied_unless_it_is_accepted(ryugu, tmp_path):
    workspace = tmp_path / "WS"
    scaled = workspace / "solutions" / "scaled-1"
    shutil.copytree(ryugu, workspace)
    apply = ("scale", workspace, "--method", "shots", "--apply")
    printed = CliRunner().invoke(app, [str(part) for part in apply])
    assert printed.exit_code == 1
    assert "epsilon-not-significant" in printed.output
    assert not scaled.exists()
    codes = ("epsilon-not-determined", "epsilon-not-separable", "epsilon-not-significant")
    call(*apply, *(part for code in codes for part in ("--accept", code)))
    assert (scaled / "solution.json").is_file()


@pytest.mark.real_data
def test_kilometres_read_as_metres_are_refused_at_import(ryugu, tmp_path):
    table = tmp_path / "km.csv"
    table.write_text("x_m,y_m,z_m\n" + "0.42,-0.2,0.05\n" * 20)
    result = CliRunner().invoke(app, ["import", str(ryugu), str(table)])
    assert result.exit_code == 1
    assert "km for m" in result.output
    assert not (ryugu / "scans" / "km.h5").exists()
