"""Data that do not determine the scale: a reason, no number or one with a correct sigma."""

from __future__ import annotations

import json

import pytest
from command_line import app
from typer.testing import CliRunner

from lidar.formats import read_scan

PLANTED = 2.5e-4
SMOOTH = ("shape=0", "roughness=0", "craters.density_per_km2=0", "boulders.density_per_km2=0")


def run(*arguments, code=0):
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code in (code if isinstance(code, tuple) else (code,)), result.output
    return result


def make(root, *changes):
    """Make the tiny mission of one seed, with `changes` for another body."""
    given = [part for change in changes for part in ("--set", f"body.{change}")]
    run("truth", "make", root, "--preset", "tiny", "--seed", 5, *given)
    return root


@pytest.fixture(scope="module")
def mission(tmp_path_factory):
    return make(tmp_path_factory.mktemp("refusals") / "one")


def scaled(root, spc, scans, *, code=0):
    """The content of scale.json of a workspace over an SPC solution with some scans."""
    run("init", root, "--spc", spc, "--body", "Truth")
    run("import", root, *scans)
    run("scale", root, code=code)
    return json.loads((root / "scale.json").read_text())


def covers(content):
    """Whether the sigma of ε covers what was planted."""
    return abs(content["epsilon"] - PLANTED) < 3 * content["epsilon_sigma"]


def height(path):
    """How far north the ground of a scan lies, metres."""
    return read_scan(path).points[:, 2].mean()


def is_silent(content):
    """Return whether there is no result, with reasons, also for each image."""
    stated = content["reasons"][0].startswith("nothing is observed")
    everyone = all(pair["reason"] and not pair["used"] for pair in content["per_pair"])
    return content["epsilon"] is None and not content["converged"] and stated and everyone


def test_lidar_of_another_body_is_no_match(mission, tmp_path):
    other = make(tmp_path / "other", "seed=6")
    content = scaled(tmp_path / "WS", mission / "spc", sorted((other / "lidar").iterdir()), code=1)
    assert content["verdict"] == "refused"
    # Taken at the same times from the same places: only the ground is another.
    assert is_silent(content)


def test_a_sphere_without_relief_determines_heights_alone(tmp_path):
    smooth = make(tmp_path / "smooth", *SMOOTH)
    # Most pairs have nothing that holds a match: that a few do may be doubtful.
    scans = sorted((smooth / "lidar").iterdir())
    content = scaled(tmp_path / "WS", smooth / "spc", scans, code=(0, 1))
    assert content["verdict"] != "refused"
    assert covers(content)
    # Without relief positions along the surface are free: decimetres instead of centimetres.
    assert min(content["center_offset_sigma_m"]) > 0.2
    for pair in content["per_pair"]:
        assert pair["used"] or pair["reason"]


def test_a_single_scan_does_not_separate_size_and_centre(mission, tmp_path):
    scan = sorted((mission / "lidar").iterdir())[0]
    content = scaled(tmp_path / "WS", mission / "spc", [scan])
    assert covers(content)
    # A thousand times what all eight scans know.
    assert content["epsilon_sigma"] > 1e-3
    assert any("not separable" in reason for reason in content["reasons"])
    # A weak term is an honest sigma, and no fault.
    assert content["verdict"] == "accepted"
    assert {"epsilon-not-separable"} < {found["code"] for found in content["findings"]}
    assert "per-day terms: all observations are of one day" in content["reasons"]


def test_one_cap_gives_larger_sigmas(mission, tmp_path):
    # The two scans nearest to the north pole, at 60° and 38° of latitude.
    scans = sorted((mission / "lidar").iterdir(), key=height)[-2:]
    content = scaled(tmp_path / "WS", mission / "spc", scans)
    assert covers(content)
    assert content["epsilon_sigma"] > 5e-5
