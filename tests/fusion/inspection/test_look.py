"""``spcola look``: every kind of file from the command line to its picture."""

from __future__ import annotations

import json
import os
from base64 import b64decode
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import app
from matplotlib.colors import to_rgb
from numpy.typing import NDArray
from PIL import Image
from typer.testing import CliRunner

import fusion
from fusion.fusing.maplets import FusedMaplet, write_fused
from fusion.report.layout import Colour
from lidar.formats.mapolas import write_mapolas
from lidar.formats.native import write_scan
from lidar.gridding import Mapola
from lidar.scans import Scan
from spcola.camera import Camera, ImagePoint, SpcImage, project_image
from spcola.control import Landmark
from spcola.formats.images import write_image_data
from spcola.formats.maplets import write_maplet
from spcola.formats.shapes import write_icq
from spcola.formats.shapes.ply import write_ply_mesh
from spcola.formats.solution import write_landmark, write_summary
from spcola.grids import Maplet, MapletGrid
from spcola.math import lattice
from spcola.shape.icq import IcqShape, icq_directions

Array = NDArray[np.float64]
GRID = MapletGrid.facing([0.0, 250.0, 0.0], [0.0, 1.0, 0.0], 0.5, 8)


@pytest.fixture
def here(tmp_path: Path) -> Iterator[Path]:
    """A folder that is the current one."""
    before = Path.cwd()
    os.chdir(tmp_path)
    yield tmp_path
    os.chdir(before)


def call(*arguments: object, code: int = 0) -> str:
    result = CliRunner().invoke(app, ["look", *map(str, arguments)])
    assert result.exit_code == code, result.output
    if code:
        assert result.stderr.count("\n") == 1
    return result.stderr if code else result.stdout


def drawn(*arguments: object) -> Any:
    """What was drawn, by --json; the picture is one that opens."""
    content = json.loads(call(*arguments, "--json"))
    with Image.open(content["picture"]) as image:
        assert min(image.size) > 500
    return content


def heights() -> Array:
    height = np.cumsum(np.random.default_rng(1).normal(size=(17, 17)), axis=0) * 0.1
    height[:, 12:] = np.nan
    return height


def shows(path: str, colour: str) -> float:
    """Share of a picture that has a colour."""
    pixels = np.asarray(Image.open(path).convert("RGB")) / 255.0
    return float(np.mean(np.abs(pixels - to_rgb(colour)).max(axis=-1) < 0.01))


def test_a_maplet_and_its_gaps(here: Path) -> None:
    write_maplet("AA0001.MAP", Maplet("AA0001", GRID, heights()))
    found = drawn("AA0001.MAP")
    assert (found["kind"], found["missing"]) == ("maplet", 85)
    assert found["side_m"] == pytest.approx(8.0)
    assert found["picture"] == "AA0001.png"
    assert found["longitude_deg"] == pytest.approx(90.0)
    gaps = shows("AA0001.png", Colour.MISSING)
    write_maplet("AA0001.MAP", Maplet("AA0001", GRID, np.nan_to_num(heights())))
    drawn("AA0001.MAP")
    assert gaps > 0.1
    assert shows("AA0001.png", Colour.MISSING) == 0.0


def test_a_notebook_shows_the_picture(here: Path) -> None:
    write_maplet("AA0001.MAP", Maplet("AA0001", GRID, heights()))
    shown = fusion.look_at("AA0001.MAP")._repr_html_()
    encoded = shown.partition("data:image/png;base64,")[2].removesuffix('">')
    with Image.open(BytesIO(b64decode(encoded))) as image:
        assert min(image.size) > 500


def test_mapolas_and_fused_maplets_with_the_layers_of_their_folder(here: Path) -> None:
    height = heights()
    count = np.isfinite(height).astype(int)
    for folder in ("mapolas", "fused"):
        (here / folder).mkdir()
    mapola = Mapola("AA0001", GRID, height, count=count, spread=np.where(count, 0.1, np.nan))
    write_mapolas(here / "mapolas", [mapola])
    fused = FusedMaplet("AA0001", GRID, height, count=count, source=3 * count)
    write_fused(here / "fused", [fused])
    assert drawn("mapolas/AA0001.MAP")["kind"] == "mapola"
    found = drawn("fused/AA0001.MAP")
    assert found["kind"] == "fused maplet"
    assert found["share_by_source"]["both"] == pytest.approx(count.mean())


def test_a_pair_of_bigmaps_and_their_difference(here: Path) -> None:
    height = np.nan_to_num(heights())
    write_maplet("P01-maplets.MAP", Maplet("P01-maplets", GRID, height))
    write_maplet("P01-returns.MAP", Maplet("P01-returns", GRID, height + 0.25))
    for part in ("maplets", "returns"):
        found = drawn(f"P01-{part}.MAP")
        assert found["kind"] == "pair of bigmaps"
        assert found["difference_mean_m"] == pytest.approx(0.25, abs=1e-3)
        assert found["difference_std_m"] < 1e-3


@pytest.fixture
def solution(here: Path) -> SpcImage:
    """An image that sees three landmarks, each found 2 pixels from where it is expected."""
    camera = Camera(100.0, [32.5, 24.5], [[10.0, 0, 0], [0, 10.0, 0]], 64, 48)
    axes = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    image = SpcImage("IMG1", "2019 MAR 01 00:00:00.000", camera, [1000.0, 0, 0], axes, [-1.0, 0, 0])
    for folder in ("SUMFILES", "LMKFILES", "IMAGEFILES", "SHAPEFILES"):
        (here / folder).mkdir()
    seen = []
    for number, place in enumerate([[-10.0, 1.0, 0.5], [-10.0, -1.5, 0.2], [-10.0, 0.3, -1.0]]):
        grid = MapletGrid.facing(place, [-1.0, 0.0, 0.0], 0.1, 3)
        pixel, line = project_image(image, grid.center)
        name = f"LM000{number}"
        seen.append(ImagePoint(name, float(pixel), float(line) + 2.0))
        write_landmark(here / "LMKFILES" / f"{name}.LMK", Landmark(name, grid))
    image = SpcImage("IMG1", image.utc, camera, image.scobj, axes, image.sun, landmarks=tuple(seen))
    write_summary("SUMFILES/IMG1.SUM", image)
    return image


def test_an_image_with_the_residuals_of_its_landmarks(here: Path, solution: SpcImage) -> None:
    pixels = np.random.default_rng(0).integers(0, 255, (48, 64)).astype(np.uint8)
    write_image_data("IMAGEFILES/IMG1.DAT", pixels)
    for path in ("SUMFILES/IMG1.SUM", "IMAGEFILES/IMG1.DAT"):
        found = drawn(path)
        assert (found["kind"], found["landmarks"], found["backdrop"]) == ("image", 3, "")
        assert found["residual_rms_px"] == pytest.approx(2.0, abs=0.01)


def test_an_image_without_pixels_shows_the_lit_shape(here: Path, solution: SpcImage) -> None:
    assert "no shape" in drawn("SUMFILES/IMG1.SUM")["backdrop"]
    dark = shows("IMG1.png", "#000000")
    directions = icq_directions(8)
    write_icq("SHAPEFILES/SHAPE.TXT", IcqShape(10.0 * directions))
    assert "SHAPE.TXT" in drawn("SUMFILES/IMG1.SUM")["backdrop"]
    # The sphere fills little of the image; the rest is sky.
    assert shows("IMG1.png", "#000000") > dark + 0.2


def test_a_scan_of_a_site_and_one_around_the_body(here: Path) -> None:
    around = 250.0 * lattice(3000)
    time = np.linspace(6e8, 6e8 + 600, 3000)
    for name, points, layout in (
        ("whole", around, "body"),
        ("site", around[around[:, 2] > 200.0], "site"),
    ):
        known = {"time": time[: len(points)], "spacecraft": 4.0 * points}
        write_scan(f"{name}.h5", [Scan.of_points(name, points, **known)])
        found = drawn(f"{name}.h5")
        assert (found["layout"], found["returns"]) == (layout, len(points))
        assert found["first_utc"].startswith("2019 JAN")


def test_a_cloud_in_coordinates_of_its_own_is_a_map(here: Path) -> None:
    generator = np.random.default_rng(0)
    points = generator.uniform(-50, 50, (500, 3)) * [1.0, 1.0, 0.01]
    rows = "".join(f"{x:.3f} {y:.3f} {z:.3f}\n" for x, y, z in points)
    head = "ply\nformat ascii 1.0\nelement vertex 500\nproperty float x\nproperty float y\n"
    Path("cloud.ply").write_text(f"{head}property float z\nend_header\n{rows}")
    found = drawn("cloud.ply")
    assert (found["kind"], found["layout"], found["first_utc"]) == ("lidar", "map", None)


def test_shapes_in_their_unit(here: Path) -> None:
    shape = IcqShape(10.0 * icq_directions(6))
    write_icq("BALL.TXT", shape)
    write_ply_mesh("ball.ply", shape.mesh(), unit="m")
    assert drawn("BALL.TXT")["radius_m"] == pytest.approx([10.0, 10.0])
    assert drawn("ball.ply", "--unit", "m")["radius_m"] == pytest.approx([10.0, 10.0])


def test_a_registration_and_a_scale_with_their_verdicts(here: Path) -> None:
    entry = {"center_m": [250.0, 0, 0], "residual_m": [0.1, 0, 0], "used": True, "name": "A"}
    apart = {"center_m": [0, 250.0, 0], "residual_m": [None] * 3, "used": False, "name": "B"}
    finding = {"code": "large-scale", "severity": "doubtful", "text": "the scale is large"}
    registration = {
        "model": "similarity", "scale": 1.001, "scale_sigma": 1e-4, "rotation_deg": [0, 0, 0.1],
        "rotation_sigma_deg": [0.1] * 3, "translation_m": [0.1] * 3, "n_used": 1, "n_rejected": 1,
        "translation_sigma_m": [0.1] * 3, "residual_std_m": [0.1, None, 0.1],
        "per_mapola": [entry, apart], "verdict": "doubtful", "findings": [finding],
    }  # fmt: skip
    Path("registration.json").write_text(json.dumps(registration))
    assert drawn("registration.json")["verdict"] == "doubtful"
    scale = {"epsilon": 2e-4, "epsilon_sigma": 1e-5, "n_used": 3, "n_rejected": 0}
    Path("scale.json").write_text(json.dumps(scale))
    assert drawn("scale.json")["epsilon"] == 2e-4
    Path("other.json").write_text('{"a": 1}')
    assert "neither a registration nor a scale" in call("other.json", code=1)
    Path("scale.json").write_text('{"epsilon": 2e-4}')
    assert "lacks what is drawn" in call("scale.json", code=1)


def test_a_new_workspace(here: Path) -> None:
    result = CliRunner().invoke(app, ["init", "ws", "--body", "Bennu"])
    assert result.exit_code == 0, result.output
    found = drawn("ws")
    assert (found["kind"], found["body"], found["picture"]) == ("workspace", "Bennu", "ws.png")
    assert found["stages"]["register"].startswith("cannot run")


def test_where_a_picture_is_written(here: Path) -> None:
    write_maplet("A.MAP", Maplet("A", GRID, heights()))
    assert call("A.MAP").strip() == "A.png"
    first = Path("A.png").read_bytes()
    call("A.MAP")
    assert Path("A.png").read_bytes() == first
    Path("A.png").write_text("mine")
    assert "was not made by spcola look" in call("A.MAP", code=1)
    call("A.MAP", "-o", "A.png")
    assert Path("A.png").read_bytes() == first
    call("A.MAP", "-o", "A.svg")
    assert "<svg" in Path("A.svg").read_text()
    for wrong, why in (("A.MAP", "no name of a picture"), ("none/A.png", "cannot be written")):
        assert why in call("A.MAP", "-o", wrong, code=1)
    Path("link.png").symlink_to("A.MAP")
    assert "to be drawn itself" in call("A.MAP", "-o", "link.png", code=1)
    assert Path("A.MAP").stat().st_size > 500


@pytest.mark.parametrize(
    ("name", "content", "why"),
    [
        ("spcola.toml", "", "are settings: there is nothing to draw"),
        ("PICTLIST.TXT", "IMG1\nEND\n", "is a list of names: there is nothing to draw"),
        ("a.tpc", "KPL/PCK\n\\begindata\nBODY10_PM = (1 2 3)\n", "is a SPICE kernel"),
        ("a.txt", "Hello, world", "is text in no format that is read"),
        ("A.LMK", "A", "is not in MAPFILES"),
        ("A.MAP", "x" * 100, "A.MAP"),
    ],
)
def test_what_cannot_be_drawn_is_said_in_a_line(
    here: Path, name: str, content: str, why: str
) -> None:
    Path(name).write_text(content)
    assert why in call(name, code=1)
    assert not list(here.glob("*.png"))


def test_what_is_not_there_is_said(here: Path) -> None:
    assert "is not there" in call("none.MAP", code=1)
    assert "is not a workspace" in call(here, code=1)
