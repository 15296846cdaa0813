"""Shots located by kernels: each is used, rejected, missed, or counted as without a place."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import spiceypy
from command_line import app
from scipy.spatial import ConvexHull
from typer.testing import CliRunner, Result

from fusion.estimation.verdict import Code
from fusion.scene.geolocation.kernels import kernel_paths
from fusion.scene.geolocation.locating import geolocator
from fusion.workspace import SETTINGS_FILE, Workspace, new_workspace
from fusion.workspace.settings import Settings, load_settings, write_settings
from lidar.formats.native import write_scan
from lidar.scans import Scan
from spcola.camera import Camera, SpcImage
from spcola.errors import KernelError
from spcola.formats.maplets import write_maplet
from spcola.formats.shapes import write_obj_mesh
from spcola.formats.solution import write_summary
from spcola.grids import Maplet, MapletGrid
from spcola.navigation import SPICE_LOCK, utc_from_et
from spcola.shape import Mesh, RayCaster
from spcola.spice import KernelSet, body_fixed_states

BENNU = 2101955
START = 6.2e8
DAY = 86400.0
RADIUS = 60.0
# Images every five minutes in three bursts of two hours, over two days.
BURST = 300.0 * np.arange(25)
IMAGES = START + np.concatenate([BURST, 0.8 * DAY + BURST, 1.9 * DAY + BURST])


def body() -> Mesh:
    """An ellipsoid of 3000 vertices."""
    number = np.arange(3000)
    z = 1.0 - (2.0 * number + 1.0) / len(number)
    angle = np.pi * (3.0 - np.sqrt(5.0)) * number
    flat = np.sqrt(1.0 - z**2)
    unit = np.column_stack([flat * np.cos(angle), flat * np.sin(angle), z])
    faces = ConvexHull(unit).simplices
    normal = np.cross(*np.diff(unit[faces], axis=1).swapaxes(0, 1))
    inward = np.sum(normal * unit[faces[:, 0]], axis=1) < 0
    faces[inward] = faces[inward][:, ::-1]
    return Mesh(unit * [RADIUS, 0.9 * RADIUS, 0.8 * RADIUS], faces)


def kernels(folder: Path) -> list[Path]:
    """Rotation of a body and a spacecraft at 800 m, as from images."""
    text, path = folder / "body.tpc", folder / "craft.bsp"
    text.write_text(
        "KPL/PCK\n\\begindata\nBODY2101955_POLE_RA = 85.45\nBODY2101955_POLE_DEC = -60.37\n"
        "BODY2101955_PM = ( 140.69 2011.15 1.8D-6 )\n\\begintext\n"
    )
    angle = 1e-5 * (IMAGES - START)
    zero = np.zeros_like(angle)
    place = np.column_stack([np.cos(angle), np.sin(angle), zero])
    rate = 1e-5 * np.column_stack([-np.sin(angle), np.cos(angle), zero])
    ends = (IMAGES[0], IMAGES[-1])
    states = 0.8 * np.hstack([place, rate])
    with SPICE_LOCK:
        handle = spiceypy.spkopn(str(path), "TEST", 0)
        spiceypy.spkw13(handle, -999, BENNU, "J2000", *ends, "S", 3, len(states), states, IMAGES)
        spiceypy.spkcls(handle)
    return [text, path]


def shots(times: np.ndarray, files: list[Path], mesh: Mesh) -> Scan:
    """Shots at a body, located by kernels; those beyond the states from where these end."""
    with KernelSet(files).load():
        station, _ = body_fixed_states(-999, BENNU, np.clip(times, IMAGES[0], IMAGES[-1]))
    away = station / np.linalg.norm(station, axis=1, keepdims=True)
    hits = RayCaster(mesh).cast(station, -away)
    noise = np.random.default_rng(4).normal(scale=0.02, size=len(times))
    points = hits.points + noise[:, None] * away
    sigma = np.full(len(times), 0.02)
    return Scan.of_points("shots", points, time=times, spacecraft=station, body="Ball", sigma=sigma)


def located(folder: Path, times: np.ndarray, **tables: dict[str, Any]) -> Workspace:
    """A workspace with shots at these times, to be located by the kernels that made them."""
    mesh, files = body(), kernels(folder)
    write_obj_mesh(folder / "ball.obj", mesh)
    workspace = new_workspace(folder / "ws", body="Ball", shape=folder / "ball.obj")
    scan = shots(times, files, mesh)
    write_scan(workspace.root / "scans" / "shots.h5", [scan])
    spice = {"kernels": [str(path) for path in files], "spacecraft": "-999", "body": BENNU}
    settings = Settings().with_table("spice", **{**spice, **tables.pop("spice", {})})
    settings = settings.with_table("scale", **{"method": "shots", **tables.pop("scale", {})})
    write_settings(workspace.root / SETTINGS_FILE, settings)
    return workspace


def scaled(workspace: Workspace) -> tuple[Result, dict[str, Any]]:
    result = CliRunner().invoke(app, ["scale", str(workspace.root), "--json"])
    return result, json.loads(workspace.scale_path.read_text())


def total(content: dict[str, Any]) -> int:
    """All that may become of a shot."""
    keys = ("n_used", "n_rejected", "missed", "outside_kernels", "outside_trajectory", "no_time")
    return sum(content[key] for key in keys)


def spread(count: int, seed: int = 1) -> np.ndarray:
    """Times within bursts of images, in the gaps between them, and after the last."""
    rng = np.random.default_rng(seed)
    bursts = START + rng.choice([0.0, 0.8 * DAY, 1.9 * DAY], count) + rng.uniform(0, 7200.0, count)
    gaps = START + rng.uniform(7300.0, 0.79 * DAY, 40)
    late = IMAGES[-1] + rng.uniform(10.0, 4000.0, 20)
    return np.concatenate([bursts, gaps, late])


def test_every_shot_is_counted_once(tmp_path: Path) -> None:
    times = spread(80)
    workspace = located(tmp_path, times)
    scan = shots(times, [tmp_path / "body.tpc", tmp_path / "craft.bsp"], body())
    points, beam, time = scan.points.copy(), scan.beam.copy(), scan.time.copy()
    points[10] += 5.0 * scan.beam[10]  # rejected
    beam[20:24] *= -1.0  # missed
    time[:3] = np.nan
    scan_path = workspace.root / "scans" / "shots.h5"
    write_scan(scan_path, [replace(scan, points=points, beam=beam, time=time)])
    result, content = scaled(workspace)
    assert result.exit_code == 0, result.output
    assert content["n_shots"] == len(times) == 140
    assert total(content) == 140
    assert content["outside_kernels"] == 60
    assert content["no_time"] == 3
    assert content["missed"] == 4
    assert content["n_rejected"] == 1
    assert len(content["per_shot"]) == content["n_used"] + content["n_rejected"] == 73
    assert content["spans"]["kernels_windows"] == 3
    assert content["located_within_m"] == 0.0
    (found,) = [one for one in content["findings"] if one["code"] == Code.OUTSIDE_KERNELS]
    assert (found["severity"], found["value"]) == ("note", 60.0)
    assert "60 of 140 shots are outside the kernels: they cover 20" in found["text"]
    assert "in 3 spans of states no more than max_gap_s = 600 s apart" in found["text"]
    assert any("by the kernels of [spice]" in reason for reason in content["reasons"])
    assert not any("own reference" in reason for reason in content["reasons"])


def test_shots_outside_the_states_of_images_are_counted_too(tmp_path: Path) -> None:
    """Images of the first burst alone; kernels cover all three."""
    times = spread(80)
    workspace = located(tmp_path, times)
    files = [tmp_path / "body.tpc", tmp_path / "craft.bsp"]
    with KernelSet(files).load():
        station, _ = body_fixed_states(-999, BENNU, IMAGES[:25])
    camera = Camera(100.0, [256, 256], [[60.0, 0, 0], [0, 60.0, 0]], 512, 512)
    for number, (time, place) in enumerate(zip(IMAGES[:25], station, strict=True)):
        utc = utc_from_et(time, 6)
        image = SpcImage(f"I{number:03d}", utc, camera, -place, np.eye(3), [1.0, 0, 0])
        write_summary(workspace.image_path(image.name), image)
    result, content = scaled(workspace)
    assert result.exit_code == 0, result.output
    inside = np.count_nonzero(times < IMAGES[24])
    assert content["trajectory"] == "spc"
    assert content["outside_kernels"] == 60
    assert content["n_shots"] == total(content) == 140
    # Also lost are those between two shots too far apart to know where the images were taken.
    assert 80 - inside <= content["outside_trajectory"] < 80
    assert 0.0 < content["located_within_m"] < 1.0


def test_the_kernels_that_made_the_shots_leave_them_where_they_are(tmp_path: Path) -> None:
    """Over two days, in which the body turns eleven times: each is asked for."""
    workspace = located(tmp_path, spread(300))
    settings = load_settings(workspace.root / SETTINGS_FILE)
    scan = shots(spread(300), [tmp_path / "body.tpc", tmp_path / "craft.bsp"], body())
    locator = geolocator(workspace, settings.spin, settings.spice, max_gap_s=600.0)
    moved, within = locator.located(scan)
    kept = np.isin(scan.time, moved.time)
    assert within == 0.0
    assert dict(moved.rejected) == {"outside kernels": 60}
    np.testing.assert_allclose(moved.points, scan.points[kept], atol=1e-6)
    # A wider gap lets in what lies between images, an endless one all but what lies beyond.
    assert (
        len(geolocator(workspace, settings.spin, settings.spice, max_gap_s=DAY).located(scan)[0])
        == 340
    )


def test_shots_of_other_days_are_no_matter_of_frames_and_units(tmp_path: Path) -> None:
    workspace = located(tmp_path, IMAGES[-1] + np.linspace(100.0, 4000.0, 50))
    result, content = scaled(workspace)
    assert result.exit_code == 1
    assert content["verdict"] == "refused"
    assert content["n_shots"] == content["outside_kernels"] == total(content) == 50
    assert "50 of 50 shots are outside the kernels: they cover" in content["reason"]
    assert "the shots are of" in content["reason"]
    assert "frame" not in content["reason"]
    assert "outside-kernels" in result.stderr
    assert result.stderr.count("error:") == 1


def test_states_that_are_all_far_apart_are_named(tmp_path: Path) -> None:
    workspace = located(tmp_path, spread(50), scale={"max_gap_s": 100.0})
    _, content = scaled(workspace)
    assert content["outside_kernels"] == content["n_shots"] == 110
    assert "all their states, of 20" in content["reason"]
    assert "are more than max_gap_s = 100 s apart" in content["reason"]


def test_mapolas_without_kernels_of_their_time_name_the_spans(tmp_path: Path) -> None:
    workspace = located(tmp_path, IMAGES[-1] + np.linspace(100.0, 4000.0, 50))
    grid = MapletGrid.facing([RADIUS, 0.0, 0.0], [1.0, 0.0, 0.0], 0.5, 8)
    maplet = Maplet("AA0001", grid, np.zeros(grid.shape))
    write_maplet(workspace.root / "MAPFILES" / "AA0001.MAP", maplet)
    result = CliRunner().invoke(app, ["mapolas", str(workspace.root)])
    assert result.exit_code == 1
    assert "50 of 50 returns cannot be geolocated" in result.stderr
    assert "by the kernels: they cover 20" in result.stderr
    assert "frame" not in result.stderr


def test_pcks_that_contradict_each_other_are_refused_by_what_it_means_for_the_scans(
    tmp_path: Path,
) -> None:
    """In W2 alone: 1.8e-6 deg/d² over the 19.6 years since J2000."""
    workspace = located(tmp_path, spread(50))
    other = tmp_path / "other.tpc"
    other.write_text((tmp_path / "body.tpc").read_text().replace("1.8D-6", "0.0"))
    files = [str(tmp_path / name) for name in ("body.tpc", "other.tpc", "craft.bsp")]
    spice = {"kernels": files, "spacecraft": "-999", "body": BENNU}
    settings = Settings().with_table("scale", method="shots").with_table("spice", **spice)
    write_settings(workspace.root / SETTINGS_FILE, settings)
    result = CliRunner().invoke(app, ["scale", str(workspace.root)])
    assert result.exit_code == 1
    (line,) = [line for line in result.stderr.splitlines() if line.startswith("error")]
    assert "body.tpc: BODY2101955_PM is (140.69, 2011.15, 1.8e-06), but (140.69, 2011" in line
    assert "in other.tpc: turned by up to 92.7 deg or " in line
    assert "m at a radius of 5" in line or "m at a radius of 6" in line
    assert line.endswith("choose one of them as [spice] prime_meridian")
    chosen = settings.with_table("spice", **spice, prime_meridian="body.tpc")
    reference = {"reference": files, "frame": "J2000"}
    with pytest.raises(KernelError, match=r"as \[spice\] reference_prime_meridian"):
        kernel_paths(workspace, chosen.with_table("spice", **reference).spice)
    write_settings(workspace.root / SETTINGS_FILE, chosen)
    assert CliRunner().invoke(app, ["scale", str(workspace.root)]).exit_code == 0
