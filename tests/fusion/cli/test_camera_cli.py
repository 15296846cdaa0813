"""``spcola camera calibrate``: from tables and from images to a camera file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import app
from star_cruise import Cruise, check_calibration
from typer.testing import CliRunner, Result

from spcola.formats.cameras import read_cameras


def call(*arguments: object, code: int = 0) -> Result:
    result = CliRunner().invoke(app, ["camera", "calibrate", *map(str, arguments)])
    assert result.exit_code == code, result.output
    return result


@pytest.fixture
def cruise(tmp_path: Path) -> Cruise:
    return Cruise(tmp_path)


def test_from_a_table_of_positions(cruise: Cruise) -> None:
    out = cruise.folder / "new.toml"
    inputs = ["--catalogue", cruise.folder / "sky.csv", "--attitudes", cruise.attitudes()]
    result = call(
        cruise.folder / "nominal.toml", *inputs, "--stars", cruise.positions(), "-o", out, "--json"
    )
    assert result.stderr == ""
    content = json.loads(result.stdout)
    check_calibration(content, out)
    assert content["left_out"] == {}
    assert len(content["frames"]) == 6
    for frame, (_, ra, dec, twist) in zip(content["frames"], cruise.pointing, strict=True):
        solved = [frame["ra_deg"], frame["dec_deg"], frame["twist_deg"] % 360]
        np.testing.assert_allclose(solved, [ra, dec, twist], atol=5e-3)
    text = call(
        cruise.folder / "nominal.toml", *inputs, "--stars", cruise.folder / "stars.csv", "-o", out
    )
    assert "focal_length_mm: 125." in text.stdout
    assert "unit variance" in text.stdout


def test_from_images(cruise: Cruise) -> None:
    cruise.images()
    out = cruise.folder / "new.toml"
    result = call(
        cruise.folder / "nominal.toml", "--catalogue", cruise.folder / "sky.csv",
        "--attitudes", cruise.attitudes(files=True), "-o", out, "--json",
    )  # fmt: skip
    content = json.loads(result.stdout)
    check_calibration(content, out)
    assert content["left_out"] == {}
    identified = sum(frame["stars"] for frame in content["frames"])
    assert identified > 0.95 * sum(len(spots) for spots in cruise.spots.values())


def test_an_image_that_cannot_be_identified_is_left_out_with_its_reason(cruise: Cruise) -> None:
    cruise.pointing[2] = ("S2", 85.0, 17.5, 10.0)
    out = cruise.folder / "new.toml"
    result = call(
        cruise.folder / "nominal.toml", "--catalogue", cruise.folder / "sky.csv",
        "--attitudes", cruise.attitudes(), "--stars", cruise.positions(), "-o", out, "--json",
    )  # fmt: skip
    content = json.loads(result.stdout)
    check_calibration(content, out)
    assert list(content["left_out"]) == ["S2"]
    assert "chance" in content["left_out"]["S2"] or "agree" in content["left_out"]["S2"]


def test_refusals_are_one_line_and_write_nothing(cruise: Cruise) -> None:
    out = cruise.folder / "new.toml"
    sky, att = cruise.folder / "sky.csv", cruise.attitudes()
    stars = cruise.positions()
    away = cruise.write("away.csv", "image,ra,dec,twist", [("S0", 85, -40, 0)])
    good = [cruise.folder / "nominal.toml", "--catalogue", sky, "--attitudes", att]
    for arguments, message in (
        ([*good, "-o", out], "no column file"),
        ([*good, "--stars", stars, "-o", out, "--name", "WAC"], "has no camera 'WAC'"),
        ([*good, "--stars", stars, "-o", out, "--model", "fisheye"], "is no model"),
        ([*good, "--stars", sky, "-o", out], "has no column pixel"),
        ([*good[:-1], away, "--stars", stars, "-o", out], "no image's stars were identified (S0"),
    ):
        result = call(*arguments, code=1)
        assert message in result.stderr
        assert result.stderr.count("\n") == 1
    assert not out.exists()
    assert call("x.toml", code=2).stdout == ""


def test_help_has_an_example() -> None:
    assert "Example: spcola camera calibrate" in call("--help").stdout


def converted(*arguments: object, code: int = 0) -> Result:
    result = CliRunner().invoke(app, ["camera", "convert", *map(str, arguments)])
    assert result.exit_code == code, result.output
    return result


@pytest.mark.real_data
def test_convert_polycam_at_a_range(shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "bennu" / "kernels_mapcam_20190303"
    kernels = [folder / "orx_ocams_v07.ti", folder / "orex_ocams_addendum_v10.ti"]
    out = tmp_path / "polycam.toml"
    common = [*kernels, "--number", -64360, "--filter", "PAN", "-o", out]
    converted(*common, "--name", "POLYCAM")
    whole = read_cameras(out)["POLYCAM"]
    assert whole.focus is not None
    assert len(whole.focus.motor) == 94
    content = json.loads(converted(*common, "--range", 200, "--json").stdout)
    (one,) = content["cameras"]
    assert one["focal_length_mm"] == pytest.approx(615.0, abs=0.2)
    assert one["assumed"] == []
    assert read_cameras(out)["ORX_OCAMS_POLYCAM"].camera.focal_length_mm == one["focal_length_mm"]
    near = converted(*common, "--range", 50)
    assert "beyond the table" in near.stdout
    mapcam = converted(*kernels, "--number", -64361, "--variant", -64364, "--range", 9, "-o", out)
    assert "temperature unknown" in mapcam.stdout


@pytest.mark.real_data
def test_convert_isd_and_colmap(shared_data: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.toml"
    converted(shared_data / "moon_lola" / "lidarObservationImage1.isd", "-o", out)
    nac = read_cameras(out)["lidarObservationImage1"].camera
    assert (nac.width, nac.height, nac.distortion_model) == (5064, 1, "lronac")
    converted(shared_data / "vesta" / "cameras.bin", "--pixel-mm", 0.014, "-o", out)
    assert read_cameras(out)["0"].camera.focal_length_mm == pytest.approx(150.0, rel=1e-3)
    apollo = shared_data / "isis_apollo_network" / "apolloImage2.isd"
    refused = converted(apollo, "-o", out, code=1)
    assert "detector_center.sample: is not stated; give the optical axis" in refused.stderr
    converted(apollo, "--optical-axis", 2862.875, 2862.875, "--summing", 4, "-o", out)
    assert read_cameras(out)["apolloImage2"].camera.distortion_model == "hasselblad"


def test_convert_refusals_are_one_line(tmp_path: Path) -> None:
    out = tmp_path / "out.toml"
    for files, message in (
        (["x.ti"], "give --number"),
        (["x.txt"], "is none of .ti"),
        (["x.toml"], "x.toml: cannot be"),
    ):
        result = converted(*files, "-o", out, code=1)
        assert message in result.stderr
        assert result.stderr.count("\n") == 1
    assert not out.exists()
