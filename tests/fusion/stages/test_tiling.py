"""``spcola spc tile``, through the real command line on a small synthetic mission."""

from __future__ import annotations

import hashlib
import re
import shutil

import numpy as np
import pytest
from ball import ball_workspace
from command_line import call, called, refused
from scipy.ndimage import map_coordinates

from fusion.pipeline import Subset
from fusion.pipeline.subset import Place
from fusion.runtime import Progress, ThreadExecutor
from fusion.stages.lithos import LithosOptions
from fusion.stages.tiling import TilingOptions, tile_solution
from fusion.stages.tiling.naming import free_letters, free_names
from fusion.workspace import Workspace
from fusion.workspace.solution_records import read_solution
from spcola.camera import project_image
from spcola.errors import SettingsError
from spcola.imagematching import ChoiceOptions, Pictures
from spcola.shape import RayCaster

TILE = ("--gsd", 0.4, "--half-size", 24)
REGION = ("--within", "30,40,18")


def digests(folder):
    return {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest()
        for name in ("MAPFILES", "LMKFILES", "SUMFILES", "SHAPEFILES")
        for path in (folder / name).iterdir()
    }


@pytest.fixture(scope="module")
def mission(tmp_path_factory):
    """A workspace without lidar, and the digests of its solution before anything was made."""
    root = tmp_path_factory.mktemp("tile")
    call("truth", "make", root / "M", "--preset", "tiny", "--seed", 4)
    call("init", root / "WS", "--spc", root / "M" / "spc", "--body", "Truth")
    return root / "WS", digests(root / "WS")


@pytest.fixture(scope="module")
def tiled(mission):
    """What the command printed for a region."""
    return called("spc", "tile", mission[0], *TILE, *REGION, "--as", "fine")


def test_the_region_is_covered_and_the_record_says_so(mission, tiled):
    record = read_solution(mission[0], "fine")
    assert (record.parent, record.made_by) == ("imported", "spcola spc tile")
    assert record.facts["tiling"]["within"] == [30.0, 40.0, 18.0]
    assert record.facts["made"]["maplets"] == tiled["maplets"] == sum(tiled["passes"])
    assert tiled["covered"] == 1.0
    made = Workspace.open(mission[0], "fine")
    new = [name for name in made.maplet_names() if name.startswith("AA")]
    assert new == [name for name in made.landmark_names() if name.startswith("AA")]
    assert (new[0], new[-1], len(new)) == (tiled["first"], tiled["last"], tiled["maplets"])
    assert all(Place(30.0, 40.0, 20.0).holds(made.maplet(name).grid.center) for name in new)


def test_what_was_there_is_untouched_and_shared(mission, tiled):
    root, before = mission
    assert digests(root) == before
    assert before.items() <= digests(root / "solutions" / "fine").items()
    assert tiled["replaced"] == 0


def test_heights_are_those_of_the_coarser_maplets(mission, tiled):
    made = Workspace.open(mission[0], "fine")
    coarse = [made.maplet(name) for name in made.maplet_names() if name.startswith("TR")]
    apart = []
    for name in (tiled["first"], tiled["last"]):
        points = made.maplet(name).points().reshape(-1, 3)
        for one in coarse:
            x, y, height = one.grid.project(points)
            places = np.stack([y, x]) + one.grid.half_size
            own = map_coordinates(one.height, places, order=1, cval=np.nan)
            close = np.abs(own - height) < 3.0  # not the far side of the body
            apart.append((own - height)[close])
    found = np.concatenate(apart)
    assert found.size > 1000
    # The maplets disagree by as much themselves: each has errors of its own.
    assert np.sqrt(np.mean(found**2)) < 0.15
    assert tiled["from_maplets"] > 0.99


def test_landmarks_have_images_overlaps_and_sigmas(mission, tiled):
    made = Workspace.open(mission[0], "fine")
    images = {image.name: image for image in made.images()}
    grids = {name: made.landmark(name).grid for name in made.landmark_names()}
    pictures = 0
    for name in (name for name in grids if name.startswith("AA")):
        landmark, maplet = made.landmark(name), made.maplet(name)
        np.testing.assert_allclose(landmark.grid.center, maplet.grid.center, atol=1e-3)
        assert abs(maplet.height[24, 24]) < 1e-3
        for point in landmark.pictures:
            pixel, line = project_image(images[point.name], landmark.grid.center)
            assert (point.pixel, point.line) == pytest.approx((pixel, line), abs=0.02)
        assert len(landmark.overlaps) >= 3
        assert any(one.name.startswith("TR") for one in landmark.overlaps)
        for one in landmark.overlaps:
            x, y, _ = landmark.grid.project(grids[one.name].center)
            assert (one.x, one.y) == pytest.approx((x, y), abs=0.02)
        np.testing.assert_allclose(landmark.sigma, 0.06, rtol=0.02)
        pictures += len(landmark.pictures)
    assert pictures / tiled["maplets"] == pytest.approx(tiled["pictures"])
    assert pictures > tiled["maplets"]


def test_of_many_images_those_in_light_that_differs_are_chosen(mission):
    given = ("--within", "30,40,18", "--max-images", 3, "--as", "few")
    called("spc", "tile", mission[0], *TILE, *given)
    made = Workspace.open(mission[0], "few")
    light = LithosOptions.of(made.settings(), Subset.of()).photoclinometry.function
    images, caster = made.images(), RayCaster(made.shape())
    pictures = Pictures(images, caster, ChoiceOptions(most=3, light=light))
    by_views = Pictures(images, caster, ChoiceOptions(most=3))
    differ = 0
    for name in (name for name in made.landmark_names() if name.startswith("AA")):
        landmark = made.landmark(name)
        found = [point.name for point in landmark.pictures]
        assert found == [point.name for point in pictures.of(landmark.grid)]
        differ += found != [point.name for point in by_views.of(landmark.grid)]
    assert differ > 0


def test_from_the_shape_with_coarser_maplets_replaced(mission):
    root = mission[0]
    made_by = called(
        "spc", "tile", root, "--gsd", 2, "--half-size", 8, "--from", "shape",
        "--sigma", 0.7, "--letters", "sh", "--as", "rough",
    )  # fmt: skip
    assert made_by["from_shape"] == pytest.approx(1.0)
    assert made_by["stated_sigma"] == 0
    made = Workspace.open(root, "rough")
    caster = RayCaster(made.shape())
    maplet = made.maplet("SH0001")
    points = maplet.points()[maplet.valid]
    assert caster.closest(points).distance.max() < 2e-3
    np.testing.assert_allclose(made.landmark("SH0001").sigma, 0.7)
    again = called("spc", "tile", root, *TILE, "--solution", "rough", "--replace", "--as", "finer")
    finer = Workspace.open(root, "finer")
    assert again["replaced"] == made_by["maplets"] + 24
    assert finer.maplet_names() == finer.landmark_names()
    assert len(finer.maplet_names()) == again["maplets"]
    assert not (finer.home / "MAPFILES" / "SH0001.MAP").exists()
    assert not any(image.landmarks for image in finer.images())
    assert (made.home / "MAPFILES" / "SH0001.MAP").exists()


def test_a_dry_run_writes_nothing(mission):
    root = mission[0]
    before = sorted((root / "solutions").iterdir()) if (root / "solutions").exists() else []
    found = called("spc", "tile", root, *TILE, *REGION, "--dry-run")
    assert found["dry_run"]
    assert 3 < found["maplets"] < 100
    assert 0 < found["disk_mb"] < 5
    line = call("spc", "tile", root, *TILE, *REGION, "--dry-run").stdout
    assert line.startswith(f"{found['maplets']} maplets of 0.4 m")
    assert sorted((root / "solutions").iterdir() if before else []) == before


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--gsd", 2), "coarser than all 24 maplets"),
        (("--gsd", 0.5, "--half-size", 300), "wider than|m wide, on a body"),
        (("--gsd", 1e-4), "at least .* maplets"),
        (("--gsd", 0.5, "--within", "95,0,1"), "LAT,LON,RADIUS_M"),
        (("--gsd", 0.5, "--letters", "A1"), "two letters"),
        (("--gsd", 0.5, "--as", "fine"), "already; name another"),
        (("--gsd", 0.5, "--as", "imported"), "taken"),
        (("--gsd", 0.5, "--as", "a/b"), "no name for a solution"),
    ],
)
def test_refusals_are_one_line(mission, tiled, arguments, says):
    assert tiled
    line = refused("spc", "tile", mission[0], *arguments)
    assert re.search(says, line), line


def test_nothing_to_seed_from_is_refused(tmp_path):
    ball_workspace(tmp_path / "WS")
    line = refused("spc", "tile", tmp_path / "WS", "--gsd", 0.25, "--from", "shape")
    assert "no shape in SHAPEFILES" in line
    line = refused("spc", "tile", tmp_path / "WS", "--gsd", 0.25, "--within", "89,0,3")
    assert "no surface in the region" in line
    shutil.rmtree(tmp_path / "WS" / "MAPFILES")
    line = refused("spc", "tile", tmp_path / "WS", "--gsd", 0.25)
    assert "no shape in SHAPEFILES and no maplets" in line


def test_maplets_without_a_shape_are_enough_and_a_job_makes_one_solution(tmp_path):
    workspace = ball_workspace(tmp_path / "WS")
    options = TilingOptions(0.25, 8, region=Subset.of(within="0,0,5"))
    work = (ThreadExecutor(1), Progress())
    first = tile_solution(workspace, "", options, *work, job="j1")
    assert first.solution == "tiled-1"
    assert first.covered == 1.0
    assert first.from_maplets > 0.9
    assert first.without_pictures == first.maplets
    again = tile_solution(workspace, "", options, *work, job="j1")
    assert again.as_dict() == first.as_dict()
    assert tile_solution(workspace, "", options, *work, job="j2").solution == "tiled-2"
    made = Workspace.open(workspace.root, "tiled-1")
    maplet = made.maplet(first.first)
    radius = np.linalg.norm(maplet.points()[maplet.valid], axis=1)
    np.testing.assert_allclose(radius, 60.0, atol=5e-3)


def test_names_are_two_letters_and_four_digits_of_base_36():
    taken = ["AA0001", "AB00ZZ", "ac0001"]
    assert free_letters(taken) == "AD"
    names = free_names("ab", ["AB0002"])
    found = [next(names) for _ in range(40)]
    assert found[:3] == ["AB0001", "AB0003", "AB0004"]
    assert found[8:11] == ["AB000A", "AB000B", "AB000C"]
    assert found[34:36] == ["AB0010", "AB0011"]
    with pytest.raises(SettingsError, match="every two letters"):
        free_letters([f"{a}{b}" for a in map(chr, range(65, 91)) for b in map(chr, range(65, 91))])


@pytest.mark.parametrize("gsd", [0.0, -1.0, float("nan"), float("inf")])
def test_a_gsd_that_is_no_length_is_refused(gsd):
    """On the command line it is wrong usage (tests of numbers there)."""
    with pytest.raises(SettingsError, match="must be positive"):
        TilingOptions(gsd)
