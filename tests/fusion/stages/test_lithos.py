"""``spcola spc lithos``, through the real command line on a small synthetic mission with images."""

from __future__ import annotations

import hashlib
import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from command_line import call, called, refused

from fusion.pipeline import Subset
from fusion.pipeline.catalog.soundness import unsound_maplets
from fusion.stages.lithos import PHOTOCLINOMETRY_KEYS, LithosOptions
from fusion.workspace import Workspace
from fusion.workspace.solution_records import read_solution
from spcola.formats.image_sigmas import (
    albedo_sigma_path,
    read_albedo_sigma,
    read_slope_sigma,
    slope_sigma_path,
)
from spcola.formats.maplets import write_maplet
from spcola.formats.slope_directions import read_slope_directions, slope_directions_path
from spcola.formats.solution import read_summary, write_summary
from spcola.grids import Maplet, MapletGrid
from spcola.heights.slopes import slopes_of
from spcola.photometry.photoclinometry.surface import cell_slopes
from spcola.truth.body import TruthBody

# Two maplets that many images show, and one near a pole.
SOME = ("TR0009", "TR0012", "TR0024")


@pytest.fixture(scope="module")
def mission(imaged_mission):
    return imaged_mission


def only(*names):
    return [part for name in names for part in ("--only", name)]


def digests(folder):
    """Digests of the maplets and states of a solution."""
    return {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest()
        for name in ("MAPFILES", "SUMFILES", "LMKFILES")
        for path in (folder / name).iterdir()
    }


def with_truth(mission, solution, name):
    """A maplet, and the true heights on its grid."""
    root, settings = mission
    maplet = Workspace.open(root, solution).maplet(name)
    grid, back = maplet.grid, settings.to_spc.inverse()
    there = MapletGrid(
        back.apply(grid.center), back.turn(grid.axes), grid.gsd * back.scale, grid.half_size
    )
    return maplet, TruthBody(settings.body).heights_near(there, maplet.height) / back.scale


def slope_error(mission, solution, name):
    """Robust error of slopes of a maplet against the truth."""
    maplet, truth = with_truth(mission, solution, name)
    gsd = maplet.grid.gsd
    wrong = np.array(slopes_of(maplet.height, gsd)) - np.array(slopes_of(truth, gsd))
    return float(np.median(np.hypot(*wrong[:, 2:-2, 2:-2])))


@pytest.fixture(scope="module")
def solved(mission):
    """What the command printed, starting from the shape, and the imported files before it."""
    before = digests(mission[0])
    content = called(
        "spc", "lithos", mission[0], *only(*SOME), "--start", "shape", "--as", "images"
    )
    return content, before


def test_slopes_are_nearer_to_the_truth_than_those_of_the_solution(mission, solved):
    outcomes = {name: solved[0]["maplets"][name]["outcome"] for name in SOME}
    for name in SOME[:2]:
        assert outcomes[name] not in ("too-few-images", "diverged")
        # Pixels are as wide as two cells here.
        assert slope_error(mission, "images", name) < 0.9 * slope_error(mission, "", name)


def test_heights_err_by_their_sigmas(mission, solved):
    """With images alone: 0.95 and 0.71 sigma here; three maplets decide no more than this."""
    for name in SOME[:2]:
        maplet, truth = with_truth(mission, "images", name)
        pulls = ((maplet.height - truth) / maplet.sigma)[2:-2, 2:-2]
        assert 0.4 < np.sqrt(np.mean(pulls**2)) < 1.4


def test_slopes_err_by_the_sigmas_that_are_written(mission, solved):
    folder = mission[0] / "solutions" / "images" / "MAPFILES"
    for name in SOME[:2]:
        maplet, truth = with_truth(mission, "images", name)
        sigma = read_slope_sigma(folder / f"{name}.SSG", maplet.grid.half_size)
        wrong = cell_slopes(maplet.height - truth, maplet.grid.gsd)
        pulls = (wrong / sigma)[:, 2:-2, 2:-2]
        assert 0.4 < np.sqrt(np.mean(pulls**2)) < 1.4


def test_albedo_errs_by_the_sigma_that_is_written(mission, solved):
    """About its mean: by 0.82 and 1.16 sigma here."""
    root, settings = mission
    for name in SOME[:2]:
        path = root / "solutions" / "images" / "MAPFILES" / f"{name}.MAP"
        maplet, back = Workspace.open(root, "images").maplet(name), settings.to_spc.inverse()
        sigma = read_albedo_sigma(albedo_sigma_path(path), maplet.grid.half_size)
        points = back.apply(maplet.points()[maplet.valid])
        planted = np.full(maplet.height.shape, np.nan)
        outward = points / np.linalg.norm(points, axis=1, keepdims=True)
        planted[maplet.valid] = TruthBody(settings.body).albedo(outward)
        wrong = maplet.albedo / np.nanmean(maplet.albedo) - planted / np.nanmean(planted)
        pulls = (wrong / sigma)[2:-2, 2:-2]
        assert np.isfinite(pulls).mean() > 0.9
        assert 0.5 < np.sqrt(np.nanmean(pulls**2)) < 1.5, name


def test_other_commands_take_a_solution_of_which_some_maplets_were_solved(mission, solved):
    assert solved[0]["solution"] == "images"
    assert unsound_maplets(Workspace.open(mission[0], "images")) == ()


def test_the_solution_has_its_record_and_shares_what_is_unchanged(mission, solved):
    content, before = solved
    root = mission[0]
    assert digests(root) == before
    record = read_solution(root, "images")
    assert (record.parent, record.made_by) == ("imported", "spcola spc lithos")
    assert record.facts["lithos"]["only"] == sorted(SOME)
    assert record.facts["lithos"]["start"] == "shape"
    after = digests(root / "solutions" / "images")
    changed = {name for name in before if after[name] != before[name]}
    kept = {n for n in SOME if content["maplets"][n]["outcome"] in ("too-few-images", "diverged")}
    assert {name for name in changed if name.endswith(".MAP")} == {
        f"{name}.MAP" for name in set(SOME) - kept
    }
    assert not {name for name in changed if name.endswith((".SUM", ".LMK"))}


def test_the_result_states_how_each_maplet_and_image_fits(mission, solved):
    content, _ = solved
    path = mission[0] / "solutions" / "images" / "photoclinometry.json"
    written = json.loads(path.read_text())
    assert set(written) == {key for key in PHOTOCLINOMETRY_KEYS if "[" not in key} | {"maplets"}
    assert written["maplets"] == content["maplets"]
    one = written["maplets"][SOME[0]]
    assert set(one) == {
        key.removeprefix("maplets[].") for key in PHOTOCLINOMETRY_KEYS if key.startswith("maplets[")
    }
    assert one["residual"] < 0.6 * one["residual_start"]
    # The shape stands for the maplets around.
    assert one["around"] == []
    assert sum(one["directions"]) == pytest.approx(1.0)
    space = Workspace.open(mission[0], "images")
    maplet = space.maplet(SOME[0])
    assert one["sigma_m"] == pytest.approx(np.nanmedian(maplet.sigma), rel=1e-3)
    half, path = maplet.grid.half_size, space.maplet_path(SOME[0])
    slopes = read_slope_sigma(slope_sigma_path(path), half)
    albedo = read_albedo_sigma(albedo_sigma_path(path), half)
    assert one["slope_sigma"] == pytest.approx(np.nanmedian(slopes), rel=1e-3)
    found = read_slope_directions(slope_directions_path(path), half)
    shares = [np.mean(found.count == number) for number in range(3)]
    np.testing.assert_allclose(shares, one["directions"], rtol=1e-12)
    assert one["albedo_sigma"] == pytest.approx(np.nanmedian(albedo), rel=0.05)
    used = [fit for fit in one["images"].values() if fit["fit"] == "used"]
    assert len(used) >= 3
    assert max(np.hypot(*fit["shift_px"]) for fit in used) < 3.0
    image = next(iter(one["images"]))
    assert written["images"][image]["maplets"] >= 1


def test_a_second_run_finds_the_maplets_again_and_writes_the_same_bytes(mission, solved):
    again = called(
        "spc", "lithos", mission[0], *only(*SOME[::-1]), "--start", "shape", "--as", "again"
    )
    assert again["maplets"] == solved[0]["maplets"]
    folder = mission[0] / "solutions"
    assert digests(folder / "again") == digests(folder / "images")
    items = mission[0] / ".items" / "lithos"
    times = {path.name: path.stat().st_ctime_ns for path in items.iterdir()}
    assert len(times) == len(SOME)
    for path in items.iterdir():
        path.unlink()
    called("spc", "lithos", mission[0], *only(*SOME), "--start", "shape", "--as", "anew")
    assert digests(folder / "anew") == digests(folder / "images")


def test_the_lidar_constrains_the_heights(mission, solved):
    root, _ = mission
    name = SOME[0]
    both = called(
        "spc", "lithos", root, *only(name), "--start", "shape", "--constraint", "lidar",
        "--constraint", "shape",
    )  # fmt: skip
    assert both["solution"] == "lithos-1"
    assert both["maplets"][name]["sigma_m"] < solved[0]["maplets"][name]["sigma_m"]
    lidar = Workspace.open(root).mapola(name)
    with_lidar = Workspace.open(root, "lithos-1").maplet(name)
    alone = Workspace.open(root, "images").maplet(name)
    grid = with_lidar.grid
    x, y, height = grid.project(lidar.points().reshape(-1, 3))
    inside = np.isfinite(height) & (np.abs(x) < 20) & (np.abs(y) < 20)
    places = np.rint([y[inside], x[inside]]).astype(int) + grid.half_size

    def spread(maplet):
        return np.std(height[inside] - maplet.height[tuple(places)])

    assert spread(with_lidar) < spread(alone)


def test_with_the_lidar_in_every_round_slopes_are_better_than_with_images_alone(mission, solved):
    root, _ = mission
    before = digests(root)
    content = called("fuse", root, "--from", "images", *only(*SOME[:2]))
    assert content["solution"] == "spcola-1"
    assert content["options"]["constraints"] == ["shape", "overlaps", "coarser", "returns"]
    assert content["options"]["start"] == "maplet"
    for name in SOME[:2]:
        assert slope_error(mission, "spcola-1", name) < 0.9 * slope_error(mission, "images", name)
    record = read_solution(root, "spcola-1")
    assert record.made_by == "spcola fuse --from images"
    assert record.facts["residual"] == content["residual"] < content["residual_start"]
    registration = hashlib.sha256((root / "registration.json").read_bytes()).hexdigest()
    assert record.digests["registration.json"] == registration
    used = next(iter(content["images"]))
    assert f"SUMFILES/{used}.SUM" in record.digests
    assert digests(root) == before
    # Items of a part of the maplets are kept for the others.
    assert len(list((root / ".items" / "spcola").iterdir())) == 2


def test_a_registration_that_may_not_be_used_is_refused(mission, tmp_path):
    root = tmp_path / "WS"
    shutil.copytree(mission[0], root, symlinks=True)
    path = root / "registration.json"
    content = json.loads(path.read_text())
    finding = {"code": "strain", "severity": "doubtful", "text": "the frames are strained"}
    content |= {"verdict": "doubtful", "findings": [finding]}
    path.unlink()
    path.write_text(json.dumps(content))
    given = ("fuse", root, "--from", "images", *only(SOME[0]))
    assert "--accept strain" in refused(*given)
    assert called(*given, "--accept", "strain")["options"]["constraints"][-1] == "returns"


def test_maplets_around_hide_and_shade_a_maplet(mission, tmp_path):
    root = tmp_path / "WS"
    shutil.copytree(mission[0], root, symlinks=True)
    workspace = Workspace.open(root)
    own = workspace.maplet(SOME[0]).grid
    others = [n for n in workspace.maplet_names() if n != SOME[0]]

    def far(name):
        return np.linalg.norm(workspace.maplet(name).grid.center - own.center)

    near = sorted(others, key=far)[:8]

    def pixels():
        content = called("spc", "lithos", root, *only(SOME[0]), "--rounds", "1")
        return sum(one["pixels"] for one in content["maplets"][SOME[0]]["images"].values())

    before = pixels()
    # A ring of towers, outside of its square.
    for name, turn in zip(near, np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False), strict=True):
        place = own.center + 1.5 * own.radius * np.array([np.cos(turn), np.sin(turn), 0]) @ own.axes
        tower, middle = np.zeros(own.shape), own.half_size
        tower[middle - 12 : middle + 13, middle - 12 : middle + 13] = 60.0
        raised = Maplet(name, MapletGrid(place, own.axes, own.gsd, own.half_size), tower)
        (root / "MAPFILES" / f"{name}.MAP").unlink()
        write_maplet(root / "MAPFILES" / f"{name}.MAP", raised)
    assert pixels() < 0.8 * before


@pytest.mark.parametrize(
    ("given", "option"),
    [
        (["fuse", "--as", "x"], "--as"),
        (["fuse", "--from", "images", "--force"], "--force"),
        (["spc", "lithos", "--shape-sigma", "-1"], "--shape-sigma"),
    ],
)
def test_what_no_workspace_could_do_is_wrong_usage(mission, given, option):
    assert option in call(*given, mission[0], code=2).stderr


def test_options_are_for_one_run_and_settings_for_all(mission):
    options = Workspace.open(mission[0]).settings().with_table("lithos", rounds=3, psf_px=0.4)
    solved = LithosOptions.of(options, Subset.of())
    assert (solved.photoclinometry.rounds, solved.photoclinometry.psf_px) == (3, 0.4)
    assert solved.photoclinometry.function.name == "lunar-lambert"
    other = options.with_table("lithos", photometry="minnaert k=0.8")
    assert LithosOptions.of(other, Subset.of()).photoclinometry.function.name == "minnaert"


def test_a_region_is_a_subset(mission):
    grid = Workspace.open(mission[0]).maplet(SOME[0]).grid
    x, y, z = grid.center
    latitude = np.degrees(np.arctan2(z, np.hypot(x, y)))
    longitude = np.degrees(np.arctan2(y, x)) % 360.0
    content = called(
        "spc", "lithos", mission[0], "--within", f"{latitude},{longitude},1", "--rounds", 1,
        "--constraint", "none", "--constraint", "overlaps",
    )  # fmt: skip
    assert list(content["maplets"]) == [SOME[0]]
    assert content["options"]["constraints"] == ["overlaps"]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (["--constraint", "stars"], "'stars' is no kind of height"),
        (["--only", "XX0001"], "XX0001"),
        (["--as", "images"], "there is a solution 'images' already"),
        (["--photometry", "moonish"], "is none of"),
        (["--within", "10,20"], "is no place"),
    ],
)
def test_what_cannot_be_done_is_refused_in_one_line(mission, solved, given, words):
    before = sorted((mission[0] / "solutions").iterdir())
    assert words in refused("spc", "lithos", mission[0], *given)
    assert sorted((mission[0] / "solutions").iterdir()) == before


def test_without_pixels_or_registration_it_says_what_to_do(mission, tmp_path):
    call("init", tmp_path / "WS", "--spc", mission[0].parent / "M" / "spc")
    line = refused("spc", "lithos", tmp_path / "WS", "--constraint", "lidar")
    assert "spcola register" in line
    pixels = tmp_path / "WS" / "IMAGEFILES"
    for path in list(pixels.iterdir()):
        path.unlink()
    line = refused("spc", "lithos", tmp_path / "WS")
    assert "no image has both pixels and a state" in line


def test_suns_on_the_wrong_side_make_the_light_doubtful(mission, tmp_path):
    root = tmp_path / "WS"
    shutil.copytree(mission[0], root, symlinks=True)
    shutil.rmtree(root / "solutions", ignore_errors=True)
    for path in (root / "SUMFILES").glob("*.SUM"):
        image = read_summary(path)
        path.unlink()
        # The Sun on the other side of the line from the body to the camera.
        toward = image.position / np.linalg.norm(image.position)
        write_summary(path, replace(image, sun=2.0 * (image.sun @ toward) * toward - image.sun))
    names = only("TR0003", "TR0007", "TR0009", "TR0012", "TR0020")
    right = called("spc", "lithos", mission[0], *names, "--start", "shape", "--as", "right")
    wrong = called("spc", "lithos", root, *names, "--start", "shape")
    assert "light-doubtful" not in {one["code"] for one in right["findings"]}
    assert "light-doubtful" in {one["code"] for one in wrong["findings"]}
