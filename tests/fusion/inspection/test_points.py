"""``spcola align``: from files of every kind to JSON and to a moved file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import app
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from typer.testing import CliRunner

from fusion.inspection.points import read_points
from fusion.inspection.points.moved import moved_maplet, moved_scan
from lidar.formats import read_scan
from lidar.formats.clouds import write_las
from lidar.scans import Scan
from spcola.errors import InvalidValueError
from spcola.formats.maplets import read_maplet, write_maplet
from spcola.formats.shapes import read_shape, write_icq, write_obj_mesh
from spcola.grids import Maplet, MapletGrid
from spcola.math import Affine, Similarity
from spcola.shape.icq import IcqShape, icq_directions

Array = NDArray[np.float64]
PLANTED = Similarity.from_rotation_vector(
    np.radians([0.1, -0.1, 0.2]), [0.3, -0.2, 0.25], 1.001, "fixed", "moving"
)


def run(*arguments: object, code: int = 0) -> Any:
    result = CliRunner().invoke(app, ["align", *map(str, arguments)])
    assert result.exit_code == code, result.output
    if code:
        assert result.stderr.count("\n") == 1
    return result


def aligned(*arguments: object) -> Any:
    return json.loads(run(*arguments, "--json").stdout)


def relief(x: Array, y: Array) -> Array:
    return (
        0.6 * np.sin(0.4 * x) * np.cos(0.33 * y)
        + 0.2 * np.sin(1.3 * x + 0.4 * y)
        + 0.15 * np.cos(0.9 * y - 1.7 * x)
    )


def cloud(number: int, count: int = 12_000) -> Array:
    draw = np.random.default_rng(number)
    x, y = draw.uniform(-20.0, 20.0, (2, count))
    return np.column_stack([x, y, 250.0 + relief(x, y) + 0.01 * draw.normal(size=count)])


def shape(transform: Similarity | None = None) -> IcqShape:
    directions = icq_directions(12)
    radius = 100.0 * (
        1.0
        + 0.03 * np.sin(5.0 * directions[..., 0] + 1.0) * np.cos(7.0 * directions[..., 1])
        + 0.02 * np.cos(11.0 * directions[..., 2] + 4.0 * directions[..., 0])
    )
    vertices = radius[..., None] * directions
    return IcqShape(vertices if transform is None else transform.apply(vertices))


def test_clouds_from_files_to_json_and_to_a_moved_file(tmp_path: Path) -> None:
    moving, fixed = tmp_path / "a.las", tmp_path / "b.laz"
    write_las(moving, [Scan.of_points("a", PLANTED.inverse().apply(cloud(0)))], compressed=False)
    write_las(fixed, [Scan.of_points("b", cloud(1))])
    for suffix in ("ply", "laz", "h5"):
        found = aligned(moving, fixed, "-o", tmp_path / f"moved.{suffix}")
        assert found["verdict"] == "accepted"
        assert found["a"]["points"] == 12_000
        moved = read_scan(tmp_path / f"moved.{suffix}").points
        # A native scan is sorted by place.
        away, _ = cKDTree(moved).query(cloud(0))
        assert away.max() < 0.02
    assert found["parameters"][-1] == "scale"
    assert len(found["covariance"]) == 7
    assert abs(found["scale"] - PLANTED.scale) < 5.0 * found["scale_sigma"]
    turn = np.degrees(PLANTED.rotation_vector)
    off = (np.array(found["rotation_deg"]) - turn) / found["rotation_sigma_deg"]
    assert np.abs(off).max() < 5.0
    again = aligned(tmp_path / "moved.laz", fixed, "--model", "rigid")
    assert np.abs(again["shift_m"]).max() < 0.01
    lines = run(moving, fixed).stdout
    assert "verdict: accepted" in lines
    assert "scale − 1" in lines


def test_maplets_and_their_moved_copies(tmp_path: Path) -> None:
    grid = MapletGrid.facing([0.0, 0.0, 250.0], [0.0, 0.0, 1.0], 0.5, 30)
    x, y = (grid.points(np.zeros(grid.shape))[..., k] for k in range(2))
    maplet = Maplet("B", grid, relief(x, y))
    write_maplet(tmp_path / "B.MAP", maplet)
    write_maplet(tmp_path / "A.MAP", moved_maplet(maplet, PLANTED.inverse().as_affine()))
    found = aligned(tmp_path / "A.MAP", tmp_path / "B.MAP", "-o", tmp_path / "C.MAP")
    assert found["verdict"] == "accepted"
    back = read_maplet(tmp_path / "C.MAP").points() - maplet.points()
    assert np.sqrt(np.mean(back**2)) < 0.02
    with pytest.raises(InvalidValueError, match="affine"):
        moved_maplet(maplet, Affine(np.diag([1.01, 1.0, 1.0]), np.zeros(3)))


def test_shapes_in_their_formats_and_units(tmp_path: Path) -> None:
    write_icq(tmp_path / "B.TXT", shape(), digits=8)
    write_icq(tmp_path / "A.TXT", shape(PLANTED.inverse()), digits=8)
    write_obj_mesh(tmp_path / "A.obj", shape(PLANTED.inverse()).mesh())
    for name in ("A.TXT", "A.obj"):
        out = tmp_path / f"moved-{name}"
        found = aligned(tmp_path / name, tmp_path / "B.TXT", "-o", out)
        assert found["ground"] == "body"
        moved = read_shape(out).vertices - shape().mesh().vertices
        assert np.abs(moved).max() < 0.01
    refused = run(tmp_path / "A.obj", tmp_path / "B.TXT", "--unit-a", "m", code=1)
    assert "kilometres for metres" in refused.stderr


def test_what_is_refused_says_why_and_writes_nothing(tmp_path: Path) -> None:
    moving, fixed, out = (tmp_path / name for name in ("a.las", "b.las", "out.ply"))
    write_las(moving, [Scan.of_points("a", cloud(0) * [-1.0, 1.0, 1.0])], compressed=False)
    write_las(fixed, [Scan.of_points("b", cloud(1))], compressed=False)
    refused = run(moving, fixed, "-o", out, "--json", code=1)
    content = json.loads(refused.stdout)
    assert content["verdict"] == "refused"
    assert {"relief-unrelated", "fits-otherwise"} <= {each["code"] for each in content["findings"]}
    assert content["translation_m"] is content["out"] is None
    assert "mirrored in X" in refused.stderr
    assert not out.exists()
    for target, why in (("out.obj", "can be written as .ply"), ("out.MAP", "can be written as")):
        assert why in run(moving, fixed, "-o", tmp_path / target, code=1).stderr
    write_las(tmp_path / "few.las", [Scan.of_points("few", cloud(0, 20))], compressed=False)
    assert "100 are needed" in run(tmp_path / "few.las", fixed, code=1).stderr
    (tmp_path / "spcola.toml").write_text("")
    assert "no cloud and no surface" in run(tmp_path / "spcola.toml", fixed, code=1).stderr
    assert "is not there" in run(tmp_path / "none.las", fixed, code=1).stderr


def test_points_without_a_place_are_counted(tmp_path: Path) -> None:
    points = cloud(0, 300)
    rows = "".join(f"{x} {y} {z}\n" for x, y, z in points)
    head = "ply\nformat ascii 1.0\nelement vertex 301\nproperty double x\nproperty double y\n"
    path = tmp_path / "a.ply"
    path.write_text(f"{head}property double z\nend_header\nnan 0 0\n{rows}")
    source = read_points(path)
    assert (source.count, dict(source.left_out)) == (300, {"not finite": 1})


def test_a_moved_scan_keeps_its_geometry() -> None:
    points, spacecraft = cloud(0, 50), np.full((50, 3), [0.0, 0.0, 900.0])
    scan = Scan.of_points("a", points, spacecraft=spacecraft, sigma=np.full(50, 0.1))
    moved = moved_scan(scan, PLANTED.as_affine())
    np.testing.assert_allclose(moved.spacecraft + moved.range[:, None] * moved.beam, moved.points)
    np.testing.assert_allclose(np.linalg.norm(moved.beam, axis=1), 1.0)
    np.testing.assert_allclose(moved.sigma, 0.1 * PLANTED.scale)
    bare = moved_scan(Scan.of_points("b", points), PLANTED.as_affine())
    assert np.isnan(bare.range).all()
    np.testing.assert_allclose(bare.points, PLANTED.apply(points))
