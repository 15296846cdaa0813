"""Blind missions: complete, without a solution, and true to what is planted."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from astropy.io import fits
from command_line import app
from typer.testing import CliRunner, Result

from fusion.runtime import Progress, ThreadExecutor
from fusion.truth import PRESETS, make_mission, mission_size, read_truth
from fusion.truth.assessment import assess
from fusion.truth.assessment.model import MeshModel
from fusion.truth.blind.plan import blind_stations, plan_blind
from fusion.truth.blind.settings import BlindSettings, blind, blind_full, blind_small
from fusion.truth.mission import TRUTH_FILE
from fusion.truth.planted import Planted
from lidar.formats import read_scan
from spcola.camera import project_image
from spcola.errors import SettingsError, WorkspaceError
from spcola.formats.shapes import read_shape, write_obj_mesh
from spcola.navigation import et_from_utc
from spcola.shape import Mesh
from spcola.shape.icq import IcqShape, icq_directions
from spcola.spice import KernelSet, body_fixed_states
from spcola.truth.campaign import CampaignSettings
from spcola.truth.campaign.cameras import looking
from spcola.truth.kernels.names import BODY, SPACECRAFT
from spcola.truth.solid import SolidBody

SMALL = blind_small(5)
TINY = replace(
    SMALL,
    body=replace(SMALL.body, radius=30.0),
    solid=replace(SMALL.solid, spacing=1.2, boulders=4, smallest=3.0, largest=5.0, cliffs=0),
    campaign=CampaignSettings.of_phases(
        approach=9, preliminary_survey=6, detailed_survey=8, radius=30.0, detector=64
    ),
    passes=replace(SMALL.passes, count=4),
    lidar=replace(SMALL.lidar, width=40.0, spacing=1.0),
)


def run(arguments: list[object]) -> Result:
    """Run a command that succeeds."""
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.output
    return result


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Planted]:
    root = tmp_path_factory.mktemp("blind") / "mission"
    return root, make_mission(root, settings=TINY)


@pytest.fixture(scope="module")
def body(made: tuple[Path, Planted]) -> SolidBody:
    found = made[1].body()
    assert isinstance(found, SolidBody)
    return found


def test_it_has_no_file_of_a_solution(made: tuple[Path, Planted]) -> None:
    root, planted = made
    folders = {path.name for path in root.iterdir()}
    assert folders == {"calibration", "images", "kernels", "lidar", "shape", TRUTH_FILE}
    ends = {path.suffix for path in root.rglob("*") if path.is_file()} - {".json"}
    assert ends == {
        ".fits",
        ".dat",
        ".obj",
        ".bsp",
        ".bc",
        ".tf",
        ".ti",
        ".tm",
        ".tpc",
        ".tsc",
        ".tls",
    }
    assert planted.centers == {}
    assert len(planted.images) == len(list((root / "images").iterdir())) == 23


def test_what_is_planted_comes_back(made: tuple[Path, Planted], body: SolidBody) -> None:
    root, planted = made
    back = read_truth(root)
    assert isinstance(back.settings, BlindSettings)
    assert back.settings == planted.settings == TINY
    assert back.blind == json.loads(json.dumps(planted.blind))
    assert len(back.blind["overhangs"]) == len(body.overhangs) == 4


def test_labels_and_kernels_lead_to_the_true_states_and_the_planted_errors(
    made: tuple[Path, Planted],
) -> None:
    root, planted = made
    kernels = KernelSet(root / "kernels" / "blind.tm")
    for name, true in planted.images.items():
        header = fits.getheader(root / "images" / f"{name}.fits")
        stated = planted.blind["images"][name]
        time = et_from_utc(header["DATE-OBS"]) + 0.5 * header["EXPTIME"]
        assert time == pytest.approx(stated["time"], abs=2e-6)
        with kernels.load():
            frame = f"BLINDCRAFT_{header['INSTRUME']}"
            position, axes = body_fixed_states(SPACECRAFT, BODY, [time], frame=frame)
        # The nominal rotation is off by a few hundredths of a degree.
        distance = np.linalg.norm(true.position_m)
        rotated = 6e-4 * distance + 1e-3
        error = np.linalg.norm(stated["kernel_position_error_m"])
        assert np.linalg.norm(position[0] - true.position_m) < error + rotated
        assert np.abs(axes[0] @ np.array(true.axes).T - np.eye(3)).max() < 1e-3


def test_images_show_the_body_where_the_true_states_have_it(
    made: tuple[Path, Planted], body: SolidBody
) -> None:
    root, _ = made
    full = 0
    for image in plan_blind(TINY).images:
        pixels = fits.getdata(root / "images" / f"{image.truth.name}.fits")
        assert pixels.min() >= 0
        assert pixels.max() <= 4095
        points = body.surface_mesh.vertices[::7]
        sun = body.first_hits(1.5 * points, -points).normals @ image.truth.sun
        facing = np.sum((image.truth.position - points) * points, axis=1) > 0
        where = project_image(image.truth, points)
        column, line = (np.rint(w).astype(int) - 1 for w in where)
        inside = (sun > 0.7) & facing & (np.minimum(column, line) > 1)
        inside &= np.maximum(column, line) < 62
        if inside.sum() < 20:
            continue
        full += 1
        assert np.median(pixels[line[inside], column[inside]]) > 700
        off = np.ones(pixels.shape, dtype=bool)
        everything = project_image(image.truth, body.surface_mesh.vertices)
        cells = [np.rint(w).astype(int) - 1 for w in everything]
        there = (np.minimum(*cells) >= 0) & (np.maximum(*cells) < 64)
        off[cells[1][there], cells[0][there]] = False
        sky = off & ~np.isin(np.arange(64), cells[0][there])[None, :]
        if sky.sum() > 200:
            assert np.median(pixels[sky]) == pytest.approx(TINY.detector.bias, abs=5)
    assert full >= 6


def test_scans_lie_on_the_body(made: tuple[Path, Planted], body: SolidBody) -> None:
    root, planted = made
    (name, errors), *_ = planted.scans.items()
    scan = read_scan(root / "lidar" / f"{name}.dat")
    points = scan.points - np.array(errors.offset_m)
    away = body.nearest(points).distance
    assert np.median(np.abs(away)) < 0.08
    assert np.percentile(np.abs(away), 95) < 0.6


def test_the_coarse_shape_is_off_by_decimetres(made: tuple[Path, Planted], body: SolidBody) -> None:
    root, planted = made
    shape = read_shape(root / "shape" / "rough.obj")
    away = body.nearest(shape.vertices).distance
    stated = planted.blind["rough_shape"]
    assert np.sqrt(np.mean(away**2)) == pytest.approx(stated["rms_m"], rel=1e-9)
    assert 0.3 < stated["rms_m"] < 1.5
    assert stated["largest_m"] < 5.0


def test_a_run_that_was_interrupted_ends_with_the_same_bytes(
    made: tuple[Path, Planted], tmp_path: Path
) -> None:
    root, _ = made

    def digests(folder: Path) -> dict[str, str]:
        return {
            str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in folder.rglob("*")
            if path.is_file()
        }

    again = tmp_path / "again"
    make_mission(again, settings=TINY, executor=ThreadExecutor(1))
    assert digests(again) == digests(root)
    for name in ("images", "kernels", "shape"):
        sorted((again / name).iterdir())[0].unlink()
    make_mission(again, settings=TINY)
    assert digests(again) == digests(root)


def test_models_are_assessed_against_it_and_ambiguous_ground_is_left_out(
    made: tuple[Path, Planted], body: SolidBody
) -> None:
    root, planted = made
    coarse = MeshModel("rough", read_shape(root / "shape" / "rough.obj"), "body")
    exact = MeshModel("truth", body.surface_mesh, "body")
    assessment = assess(planted, [coarse, exact], None, ThreadExecutor(2), Progress())
    rough, same = assessment.models
    assert rough.distances.rms == pytest.approx(planted.blind["rough_shape"]["rms_m"], rel=0.05)
    assert same.distances.rms < 1e-9
    assert np.abs(same.errors.height).max() < 1e-3
    assert np.isfinite(rough.errors.height).all()
    assert same.distances.center_of_figure == pytest.approx(np.zeros(3), abs=1e-9)


def test_the_presets_have_the_phases_of_the_paper() -> None:
    assert blind_full().campaign.images == 5069
    counts = {"AP": 0, "PS": 0, "DS": 0}
    for leg in blind_full().campaign.legs:
        counts[leg.phase] += leg.images
    assert counts == {"AP": 927, "PS": 877, "DS": 3265}
    assert blind().campaign.images == 375
    plan = plan_blind(blind_full())
    assert len({image.truth.name for image in plan.images}) == 5069
    exposures = np.array([image.label.exposure for image in plan.images])
    assert 0.003 < exposures.min() < exposures.max() < 0.2
    for preset in (blind_small, blind, blind_full):
        size = mission_size(preset(1))
        assert size.images == preset(1).campaign.images + (42 if preset is blind else 0)
        assert size.maplets == 0
    one = TINY.campaign.legs[0]
    twice = replace(TINY.campaign, legs=(one, replace(one, day=one.day)))
    assert len(plan_blind(replace(TINY, campaign=twice)).images) == 2 * one.images
    at_once = replace(twice, legs=(replace(one, turns=1e-9, steps=1, images=1),) * 2)
    with pytest.raises(SettingsError, match="less than 10 ms apart"):
        plan_blind(replace(TINY, campaign=at_once))
    nothing = replace(TINY, campaign=replace(TINY.campaign, legs=()))
    assert plan_blind(nothing).images == ()
    with pytest.raises(SettingsError, match="blind"):
        replace(TINY, spc=True)


def test_every_fine_site_is_seen_by_the_finest_images() -> None:
    settings = blind(1)
    stations = blind_stations(settings)
    times = np.array([station.time for station in stations])
    assert (np.diff(times) > 0.01).all()
    assert len(stations) == 375 + 42
    for site in settings.solid.sites:
        ground = settings.body.radius * site.direction
        seen = 0
        for station in stations:
            x, y, z = looking(station.position, station.target) @ (ground - station.position)
            inside = max(abs(x), abs(y)) < 400 * station.camera.pixel_angle * z
            seen += inside and z * station.camera.pixel_angle <= 0.06
        assert seen >= 3


def test_a_body_is_built_on_a_given_shape_by_the_command(tmp_path: Path) -> None:
    stretched = IcqShape(icq_directions(12) * [34.0, 30.0, 26.0], name="base").mesh()
    write_obj_mesh(tmp_path / "base.obj", stretched, unit="m")
    root = tmp_path / "mission"
    changes = ["solid.spacing=2.0", "solid.boulders=0", "solid.cliffs=0", "passes.count=4"]
    changes += ["lidar.width=30", "lidar.spacing=2", "campaign.detector=32", "solid.relief=0"]
    arguments = ["truth", "make", str(root), "--preset", "blind-small", "--no-images", "--json"]
    arguments += ["--base", str(tmp_path / "base.obj"), "--base-unit", "m"]
    for change in changes:
        arguments += ["--set", change]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    planted = read_truth(root)
    body = planted.body()
    assert isinstance(body, SolidBody)
    assert np.abs(body.nearest(stretched.vertices).distance).max() < 1e-9
    assert planted.settings.body.radius == pytest.approx(stretched.mean_radius, abs=1e-3)
    write_obj_mesh(
        tmp_path / "base.obj", Mesh(1.1 * stretched.vertices, stretched.facets), unit="m"
    )
    with pytest.raises(WorkspaceError, match="is not the shape on which"):
        planted.body()


def test_only_blind_missions_take_a_base(tmp_path: Path) -> None:
    arguments = ["truth", "make", str(tmp_path / "m"), "--preset", "tiny", "--base", "no.obj"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 1
    assert "only a blind mission can be built on a given shape" in result.stderr
    arguments[4] = "blind-small"
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 1
    assert "no.obj: cannot be read" in result.stderr
    # Of another unit: too small for a body, or with too many boulders for memory.
    small = IcqShape(icq_directions(3) * 250.0, name="base").mesh()
    cases: list[tuple[Literal["m", "km"], float, str]] = [
        ("m", 0.25, "mean radius of 0.2"),
        ("km", 250e3, "too many"),
    ]
    for unit, radius, message in cases:
        scaled = Mesh(small.vertices * radius / 250.0, small.facets)
        write_obj_mesh(tmp_path / "base.obj", scaled, unit=unit)
        arguments[6:] = [str(tmp_path / "base.obj"), "--base-unit", unit]
        result = CliRunner().invoke(app, arguments)
        assert result.exit_code == 1
        assert message in result.stderr


def test_by_the_command_line_from_making_to_import(tmp_path: Path) -> None:
    root, ws = tmp_path / "mission", tmp_path / "ws"
    changes = ["solid.spacing=2.5", "passes.count=4", "lidar.spacing=1.5", "campaign.detector=32"]
    make = ["truth", "make", root, "--preset", "blind-small"]
    for change in changes:
        make += ["--set", change]
    run(make)
    run(["init", ws, "--shape", root / "shape" / "rough.obj", "--body", "Blindbody"])
    run(["import", ws, *sorted((root / "lidar").iterdir())])
    result = run(["info", ws, "--json"])
    content = json.loads(result.stdout)
    assert content["scans"] == 4
    assert content["maplets"] == 0


@pytest.mark.parametrize("preset", ["blind-small", "blind", "blind-full"])
def test_the_presets_are_named(preset: str) -> None:
    assert isinstance(PRESETS[preset](2), BlindSettings)
