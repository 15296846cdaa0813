"""Constraining heights of ``spcola spc lithos``, through the command line on a small mission."""

from __future__ import annotations

import hashlib
import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
import rasterio
from affine import Affine
from command_line import call, called, refused

from fusion.registration.results import given_registration
from fusion.scene import Scene
from fusion.stages.lithos import lidar_kind
from fusion.stages.lithos.constraint_findings import constraint_findings
from fusion.stages.lithos.returns import RegisteredReturns, noise_of_pairs, supported
from fusion.workspace import Workspace
from fusion.workspace.solution_records import read_solution
from spcola.formats.maplets import read_maplet, write_maplet
from spcola.formats.shapes import write_icq
from spcola.grids import Maplet, MapletGrid
from spcola.shape import RayCaster, shape_heights
from spcola.truth.body import TruthBody
from spcola.truth.solution import spc_shape

NAME = "TR0009"
GRID = MapletGrid.facing(np.array([80.0, 20.0, 10.0]), [0.9, 0.3, 0.2], 0.5, 20)


@pytest.fixture(scope="module")
def mission(imaged_mission, tmp_path_factory):
    """A copy of its own, and the settings."""
    root = tmp_path_factory.mktemp("constraints") / "WS"
    shutil.copytree(imaged_mission[0], root, symlinks=True)
    shutil.rmtree(root / "solutions", ignore_errors=True)
    return root, imaged_mission[1]


def solved(root, *constraints, name, only=NAME):
    """What the command printed."""
    kinds = [part for kind in constraints for part in ("--constraint", kind)]
    return called("spc", "lithos", root, "--only", only, "--start", "shape", *kinds, "--as", name)


def height_error(mission, solution, name=NAME):
    """Errors of a maplet's heights against the truth, metres."""
    root, settings = mission
    maplet = Workspace.open(root, solution).maplet(name)
    grid, back = maplet.grid, settings.to_spc.inverse()
    there = MapletGrid(
        back.apply(grid.center), back.turn(grid.axes), grid.gsd * back.scale, grid.half_size
    )
    truth = TruthBody(settings.body).heights_near(there, maplet.height) / back.scale
    return maplet.height - truth


@pytest.fixture(scope="module")
def with_returns(mission):
    return solved(mission[0], "shape", "returns", name="returns")


def test_returns_make_heights_and_their_sigmas_better(mission, with_returns):
    alone = solved(mission[0], "shape", name="alone")
    assert with_returns["options"]["constraints"] == ["shape", "returns"]
    one, other = (content["maplets"][NAME] for content in (with_returns, alone))
    assert one["sigma_m"] < other["sigma_m"]
    found, without = height_error(mission, "returns"), height_error(mission, "alone")
    assert np.std(found) < 0.6 * np.std(without)
    sigma = Workspace.open(mission[0], "returns").maplet(NAME).sigma
    assert np.sqrt(np.mean((found / sigma) ** 2)) < 1.5


def test_a_shape_of_large_facets_is_as_wrong_as_what_they_do_not_resolve(mission, tmp_path):
    """Facets of nine metres on maplets of 0.75 m: it is wrong by more than a GSD in places."""
    root, settings = tmp_path / "WS", mission[1]
    shutil.copytree(mission[0], root, symlinks=True)
    path = Workspace.open(root).shape_path()
    path.unlink()
    write_icq(path, spc_shape(TruthBody(settings.body), settings.to_spc, 6))
    assert Workspace.open(root).shape().facet_side == pytest.approx(9.5, abs=0.1)
    solved(root, "shape", name="coarse", only="TR0012")
    error = height_error((root, settings), "coarse", "TR0012")
    sigma = Workspace.open(root, "coarse").maplet("TR0012").sigma
    assert np.sqrt(np.nanmean((error / sigma) ** 2)) < 1.5


def test_they_lie_where_their_registration_puts_them(mission):
    """Each at the height of the truth at its place, up to noise and relief within a cell."""
    root, settings = mission
    workspace = Workspace.open(root)
    returns = RegisteredReturns.of(workspace)
    start = workspace.maplet(NAME)
    points = returns.constraint(start, 0.3).points
    grid, back = start.grid, settings.to_spc.inverse()
    places = grid.center + points.places @ grid.axes
    radius = np.linalg.norm(back.apply(places), axis=1)
    true = TruthBody(settings.body).radius(back.apply(places) / radius[:, None])
    assert np.median(np.abs(radius - true)) < 0.1
    assert len(points) > 500
    # A lone return is not exact, and what scans have in common is no larger than a few centimetres.
    common = np.sqrt(points.covariance.mean())
    assert 0.003 < common < 0.2
    assert (np.sqrt(np.diag(points.covariance)) >= 0.99 * common).all()


def test_scans_that_the_registration_displaces_are_displaced(mission):
    workspace = Workspace.open(mission[0])
    returns, start = RegisteredReturns.of(workspace), workspace.maplet(NAME)
    content = workspace.read_json("registration.json")
    raised = 0.3 * start.grid.uz
    for entry in content["per_scan"]:
        entry["offset_m"] = (np.array(entry["offset_m"]) + raised).tolist()
    moved = replace(returns, registration=given_registration(content, "test"))
    found = [one.constraint(start, 0.3).height[10:30, 10:30] for one in (returns, moved)]
    before, after = (np.nanmedian(height) for height in found)
    assert after - before == pytest.approx(0.3, abs=0.05)


def test_returns_in_the_wrong_place_are_named_by_the_shifts_of_all_images(mission, tmp_path):
    """Four cells aside. Nothing else shows it: images move along, and brightness fits."""
    root = tmp_path / "WS"
    shutil.copytree(mission[0], root, symlinks=True)
    shutil.rmtree(root / "solutions", ignore_errors=True)
    right = solved(root, "returns", "shape", name="right")
    path = root / "registration.json"
    content, grid = json.loads(path.read_text()), Workspace.open(root).maplet(NAME).grid
    for entry in content["per_scan"]:
        entry["offset_m"] = (np.array(entry["offset_m"]) + 3.0 * grid.ux).tolist()
    path.unlink()
    path.write_text(json.dumps(content))
    wrong = solved(root, "returns", "shape", name="wrong")
    named = [
        [one["names"] for one in content["findings"] if one["code"] == "images-displaced"]
        for content in (right, wrong)
    ]
    assert named == [[], [[NAME]]]
    assert right["maplets"][NAME]["shift_ratio"] < 1.0


def test_a_second_run_writes_the_same_bytes_and_changed_returns_are_noticed(mission, with_returns):
    root = mission[0]
    again = solved(root, "returns", "shape", name="again")
    assert again["maplets"] == with_returns["maplets"]
    folder = root / "solutions"
    for solution in ("again", "returns"):
        path = folder / solution / "MAPFILES" / f"{NAME}.MAP"
        assert path.read_bytes() == (folder / "returns" / "MAPFILES" / f"{NAME}.MAP").read_bytes()
    record = read_solution(root, "returns")
    scans = Workspace.open(root).scan_paths()
    for path in scans:
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        assert record.digests[f"scans/{path.name}"] == digest
    assert "registration.json" in record.digests


def test_the_solution_of_images_and_lidar_may_use_returns(mission):
    root = mission[0]
    text = (root / "spcola.toml").read_text()
    try:
        changed = text.replace('constraints = ["shape"]', 'constraints = ["shape", "returns"]')
        (root / "spcola.toml").write_text(changed)
        content = called("fuse", root, "--from", "images", "--only", NAME, "--as", "both")
    finally:
        (root / "spcola.toml").write_text(text)
    assert content["options"]["constraints"] == ["shape", "overlaps", "coarser", "returns"]


def test_the_error_of_the_registration_does_not_average_away(mission, monkeypatch):
    """However many cells of mapolas constrain a maplet, they are displaced together."""
    root = mission[0]

    def mapolas_alone(name):
        given = ("--only", NAME, "--start", "shape", "--constraint", "lidar", "--no-stereo")
        called("spc", "lithos", root, *given, "--as", name)
        return Workspace.open(root, name).maplet(NAME)

    one = mapolas_alone("mapolas")
    grid, workspace = one.grid, Workspace.open(root)
    matches = workspace.read_json("registration.json")["per_mapola"]
    stated = {match["name"]: match["position_covariance_m2"] for match in matches}
    covariance = Scene.of(workspace, light="none").common_covariance(NAME, grid)
    np.testing.assert_allclose(covariance, np.reshape(stated[NAME], (3, 3)))
    further = 0.3**2 * np.outer(grid.uz, grid.uz)
    monkeypatch.setattr(Scene, "common_covariance", lambda *_: covariance + further)
    other = mapolas_alone("displaced")
    np.testing.assert_allclose(other.sigma, np.hypot(one.sigma, 0.3), rtol=0.02)
    np.testing.assert_allclose(other.height, one.height, atol=0.04)


def test_mapolas_and_their_returns_at_once_are_refused(mission):
    line = refused("spc", "lithos", mission[0], "--constraint", "lidar", "--constraint", "returns")
    assert "are the same heights" in line


def test_returns_that_are_not_registered_are_refused(mission, tmp_path):
    call("init", tmp_path / "WS", "--spc", mission[0])
    assert "spcola register" in refused("spc", "lithos", tmp_path / "WS", "--constraint", "returns")


@pytest.fixture(scope="module")
def true_map(mission, tmp_path_factory):
    """The truth around the maplet at twice its GSD, as .MAP with .SIG."""
    root, settings = mission
    own = Workspace.open(root).maplet(NAME).grid
    grid, back = own.with_gsd(2.0 * own.gsd), settings.to_spc.inverse()
    there = MapletGrid(
        back.apply(grid.center), back.turn(grid.axes), grid.gsd * back.scale, grid.half_size
    )
    height = TruthBody(settings.body).heights_near(there, np.zeros(grid.shape)) / back.scale
    path = tmp_path_factory.mktemp("maps") / "TRUE.MAP"
    sigma = np.full(grid.shape, 0.02)
    write_maplet(path, Maplet("TRUE", grid, height, sigma=sigma), sigma_companion=True)
    return path


@pytest.fixture(scope="module")
def true_raster(mission, tmp_path_factory):
    """The true heights above a sphere, in longitude and latitude of the solution."""
    root, settings = mission
    center = Workspace.open(root).maplet(NAME).grid.center
    radius, step = float(np.linalg.norm(center)), 0.5
    longitude = np.degrees(np.arctan2(center[1], center[0]))
    latitude = np.degrees(np.arcsin(center[2] / radius))
    transform = Affine(step, 0.0, longitude - 30.0, 0.0, -step, latitude + 15.0)
    rows, columns = np.mgrid[:60, :120] + 0.5
    east, north = np.radians(transform @ (columns, rows))
    up = np.stack([np.cos(north) * np.cos(east), np.cos(north) * np.sin(east), np.sin(north)], -1)
    away, back = np.full(east.shape, radius), settings.to_spc.inverse()
    for _ in range(6):
        there = back.apply((away[..., None] * up).reshape(-1, 3))
        found = np.linalg.norm(there, axis=1)
        true = TruthBody(settings.body).radius(there / found[:, None])
        away = away + (true - found).reshape(away.shape) / back.scale
    path = tmp_path_factory.mktemp("maps") / "dtm.tif"
    with rasterio.open(
        path, "w", driver="GTiff", width=120, height=60, count=1, dtype="float32",
        crs=f"+proj=longlat +R={radius!r} +no_defs", transform=transform, nodata=-9999.0,
    ) as raster:  # fmt: skip
        raster.write((away - radius).astype(np.float32), 1)
    return path


def with_map(root, path, name, *more):
    given = ("--start", "shape", "--constraint", "none", "--map", path, *more)
    return called("spc", "lithos", root, "--only", NAME, *given, "--as", name)


def test_maps_set_the_heights(mission, true_map, true_raster):
    root = mission[0]
    before = np.sqrt(np.mean(height_error(mission, "") ** 2))
    for path, more in ((true_map, ()), (true_raster, ("--map-sigma", "0.1"))):
        name = path.stem.lower()
        content = with_map(root, path, name, *more)
        assert content["options"]["constraints"] == ["maps"]
        assert content["options"]["maps"] == [path.name]
        error = height_error(mission, name)
        assert np.sqrt(np.mean(error**2)) < 0.85 * before
        assert abs(np.mean(error)) < 0.03
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        assert read_solution(root, name).digests[str(path)] == digest


def test_a_map_that_changed_is_solved_again_and_one_that_did_not_is_found(mission, true_map):
    root = mission[0]
    items = root / ".items" / "lithos"
    with_map(root, true_map, "first")
    count = len(list(items.iterdir()))
    first = with_map(root, true_map, "second")
    assert len(list(items.iterdir())) == count
    moved = true_map.with_name("OTHER.MAP")
    shutil.copy(true_map, moved)
    again = with_map(root, moved, "third", "--map-sigma", "0.3")
    assert again["maplets"][NAME]["sigma_m"] > first["maplets"][NAME]["sigma_m"]
    assert len(list(items.iterdir())) == count + 1


def test_maps_of_the_settings_constrain_where_they_are_asked_for(mission, true_map):
    root = mission[0]
    shutil.copy(true_map, root / "TRUE.MAP")
    shutil.copy(true_map.with_suffix(".SIG"), root / "TRUE.SIG")
    text = (root / "spcola.toml").read_text()
    given = ("spc", "lithos", root, "--only", NAME, "--rounds", "1")
    try:
        (root / "spcola.toml").write_text(text.replace("maps = []", 'maps = ["TRUE.MAP"]'))
        assert called(*given)["options"]["maps"] == []
        content = called(*given, "--constraint", "maps", "--constraint", "shape")
    finally:
        (root / "spcola.toml").write_text(text)
    assert content["options"]["constraints"] == ["shape", "maps"]
    assert content["options"]["maps"] == ["TRUE.MAP"]
    assert "names no file" in refused(*given, "--constraint", "maps")


def test_a_map_of_other_ground_changes_nothing(mission, true_map):
    root = mission[0]
    other = max(
        Workspace.open(root).maplet_names(),
        key=lambda name: np.linalg.norm(
            Workspace.open(root).maplet(name).grid.center
            - Workspace.open(root).maplet(NAME).grid.center
        ),
    )
    given = ("spc", "lithos", root, "--only", other, "--rounds", "1", "--constraint", "shape")
    content = called(*given, "--map", true_map)
    assert called(*given)["maplets"] == content["maplets"]
    unused = [one for one in content["findings"] if one["code"] == "constraint-unused"]
    assert [one["names"] for one in unused] == [[true_map.name]]


def test_each_constraint_states_how_well_it_fits(mission, with_returns, true_map):
    """Sigmas of returns are right, and a map in another frame contradicts the others."""
    fits = with_returns["maplets"][NAME]["constraints"]
    assert fits.keys() == {"shape", "returns"}
    assert 0.7 < fits["returns"]["ratio"] < 1.4
    assert 0 < fits["returns"]["left_out"] < 0.05 * fits["returns"]["heights"]
    assert fits["shape"]["heights"] == Workspace.open(mission[0]).maplet(NAME).grid.size ** 2
    true = read_maplet(true_map)
    raised = replace(true, grid=replace(true.grid, center=1.2 * true.grid.center))
    path = true_map.with_name("RAISED.MAP")
    write_maplet(path, raised, sigma_companion=True)
    given = ("spc", "lithos", mission[0], "--only", NAME, "--start", "shape")
    content = called(*given, "--constraint", "shape", "--map", path)
    found = [one for one in content["findings"] if one["code"] == "constraint-contradicts"]
    assert all(one["names"] == [NAME] for one in found)
    assert any(path.name in one["do"] and "frame" in one["do"] for one in found)


def test_a_maplet_of_which_most_returns_are_false_is_named():
    def maplet(heights, left_out, ratio, outcome="converged"):
        fit = {"heights": heights, "left_out": left_out, "residual_m": 0.1, "ratio": ratio}
        return {"outcome": outcome, "constraints": {"returns": fit}}

    maplets = {
        "GOOD": maplet(1000, 10, 1.0),
        "FALSE": maplet(500, 500, 1.1),
        "NONE": maplet(0, 800, None),
        "FEW": maplet(3, 5, 9.0),
        "KEPT": maplet(900, 10, 9.0, "too-few-images"),
        "FAR": maplet(900, 10, 9.0),
    }
    found = list(constraint_findings(maplets, ["returns", "limbs"]))
    named = {one["code"]: one["names"] for one in found}
    assert named == {
        "heights-left-out": ["FALSE", "NONE"],
        "constraint-contradicts": ["FAR"],
        "constraint-unused": ["limbs"],
    }
    # A maplet without any image is no fault of the constraints.
    assert list(constraint_findings({}, ["returns"])) == []


def test_bad_maps_are_refused_in_one_line(mission, true_map, true_raster, tmp_path):
    (tmp_path / "text.txt").write_text("no map\n")
    (tmp_path / "CUT.MAP").write_bytes(true_map.read_bytes()[:50])
    shutil.copy(true_map, tmp_path / "BARE.MAP")
    for path, words in (
        (tmp_path / "text.txt", "is no map"),
        (tmp_path / "CUT.MAP", "is truncated"),
        (tmp_path / "BARE.MAP", "states no sigma of its heights"),
        (true_raster, "--map-sigma METRES"),
        (tmp_path / "none.tif", "cannot be read"),
        (tmp_path, "cannot be read"),
    ):
        assert words in refused("spc", "lithos", mission[0], "--map", path)


def test_coarser_maplets_and_those_of_the_same_gsd_are_two_kinds(mission, true_map, tmp_path):
    root = tmp_path / "WS"
    shutil.copytree(mission[0], root, symlinks=True)
    shutil.rmtree(root / "solutions", ignore_errors=True)
    for suffix in (".MAP", ".SIG"):
        shutil.copy(true_map.with_suffix(suffix), root / "MAPFILES" / f"CO0001{suffix}")
    listed = (root / "MAPLIST.TXT").read_text()
    (root / "MAPLIST.TXT").unlink()
    (root / "MAPLIST.TXT").write_text("CO0001\n" + listed)

    def error(kind):
        given = ("--start", "shape", "--constraint", kind)
        called("spc", "lithos", root, "--only", NAME, *given, "--as", kind)
        return np.sqrt(np.mean(height_error((root, mission[1]), kind) ** 2))

    with_coarser, with_overlaps = error("coarser"), error("overlaps")
    assert with_coarser < 0.8 * with_overlaps
    # Its sigma is 0.02 m; that of the others is half a grid step.
    (root / "MAPLIST.TXT").write_text(listed)
    given = ("--start", "shape", "--constraint", "overlaps", "--as", "without")
    called("spc", "lithos", root, "--only", NAME, *given)
    one, other = (Workspace.open(root, name).maplet(NAME) for name in ("overlaps", "without"))
    # Errors of states are taken where the nearest maplet is, which may be the coarser one.
    np.testing.assert_allclose(one.height, other.height, atol=1e-3)


def test_a_random_subset_of_heights_is_the_same_each_time(mission, with_returns):
    root = mission[0]
    given = ("spc", "lithos", root, "--only", NAME, "--start", "shape", "--constraint", "shape")
    some = ("--constraint", "returns", "--constraint-fraction", "0.2")
    first = called(*given, *some, "--as", "some")
    for path in (root / ".items" / "lithos").iterdir():
        path.unlink()
    again = called(*given, *some, "--as", "same")
    assert first["options"]["constraint_fraction"] == 0.2
    assert first["maplets"] == again["maplets"] != with_returns["maplets"]
    # Another share of the heights in each round: they do not settle, and err more.
    assert first["maplets"][NAME]["outcome"] == "not-converged"
    whole, subset = (np.std(height_error(mission, name)) for name in ("returns", "some"))
    assert whole < subset < 3.0 * whole
    assert "constraint-fraction" in call(*given, "--constraint-fraction", "0", code=2).stderr


def test_false_returns_have_no_support():
    rng = np.random.default_rng(4)
    places = np.column_stack([rng.uniform(-10, 10, (2000, 2)), rng.normal(0.0, 0.03, 2000)])
    # Ground that the start lacks, two metres wide and one high.
    hill = np.exp(-0.5 * np.sum(places[:, :2] ** 2, axis=1))
    false = rng.random(2000) < 0.01
    apart = places[:, 2] + hill + np.where(false, rng.uniform(-30, 30, 2000), 0.0)
    kept = supported(places, np.full(2000, 0.03), apart, 0.3, GRID)
    assert kept[~false].all()
    assert kept[false].mean() < 0.15
    twice = np.concatenate([places, places])
    assert supported(twice, np.full(4000, 0.03), twice[:, 2], 0.3, GRID).all()
    assert not supported(places[:2], np.full(2, 0.03), apart[:2], 0.3, GRID).any()


def test_false_returns_alone_in_a_gap_do_not_support_each_other():
    rng = np.random.default_rng(5)
    places = np.column_stack([rng.uniform(-10, 10, (2000, 2)), rng.normal(0.0, 0.03, 2000)])
    places = places[np.abs(places[:, 0]) > 3.0]
    # Two metres and less from each other, three and more from the ground.
    inside = np.column_stack([rng.uniform(-0.5, 0.5, 5), np.linspace(-4, 4, 5)])
    false = np.column_stack([inside, -18.0 + rng.normal(0.0, 0.3, 5)])
    true = np.array([[0.0, 6.0, 0.5], [0.3, 6.5, 0.5], [-0.3, 7.0, 0.6]])
    every = np.concatenate([places, false, true])
    kept = supported(every, np.full(len(every), 0.03), every[:, 2], 0.3, GRID)
    assert kept[: len(places)].all()
    assert not kept[len(places) : -3].any()
    assert kept[-3:].all()


def test_sparse_false_returns_of_all_heights_in_a_wide_gap_are_found():
    """Among twelve sparse ones some agree by chance, and chains of them make a large group."""
    rng = np.random.default_rng(0)
    places = np.column_stack([rng.uniform(-10, 10, (4000, 2)), rng.normal(0.0, 0.03, 4000)])
    places = places[np.abs(places[:, 0]) > 5.0]
    inside = rng.uniform([-5.0, -10.0], [5.0, 10.0], (200, 2))
    every = np.concatenate([places, np.column_stack([inside, rng.uniform(-20, 20, 200)])])
    kept = supported(every, np.full(len(every), 0.03), every[:, 2], 0.3, GRID)
    assert kept[: len(places)].all()
    wrong = np.abs(every[kept, 2])
    assert wrong.max() < 2.5
    assert np.sum(wrong > 1.0) < 6


def test_noise_is_found_from_close_pairs():
    rng = np.random.default_rng(4)
    places = np.column_stack([rng.uniform(-5, 5, (3000, 2)), np.zeros(3000)])
    apart = 0.2 * places[:, 0] + rng.normal(0.0, 0.03, 3000)
    assert noise_of_pairs(places, apart, 0.1) == pytest.approx(0.03, rel=0.1)
    assert noise_of_pairs(places[:30], apart[:30], 0.1) == 0.1
    assert noise_of_pairs(places, 0.0 * apart, 0.1) == 1e-4


def test_limbs_constrain_and_their_images_are_noted(mission):
    root = mission[0]
    content = solved(root, "limbs", name="limbs")
    bare = solved(root, "none", name="bare")
    assert content["options"]["constraints"] == ["limbs"]
    assert content["maplets"][NAME]["sigma_m"] < bare["maplets"][NAME]["sigma_m"]
    found, without = (height_error(mission, name) for name in ("limbs", "bare"))
    sigma = Workspace.open(root, "limbs").maplet(NAME).sigma
    assert np.sqrt(np.mean((found / sigma) ** 2)) < 1.5
    assert np.sqrt(np.mean(found**2)) < 1.2 * np.sqrt(np.mean(without**2))
    states = {f"SUMFILES/{path.name}" for path in (root / "SUMFILES").glob("*.SUM")}
    assert states <= read_solution(root, "limbs").digests.keys()


def test_the_solution_of_images_and_lidar_may_use_limbs(mission, tmp_path):
    root = mission[0]
    path = root / "spcola.toml"
    text = path.read_text()
    given = ("--from", "images", "--only", NAME, "--as")
    try:
        path.write_text(text.replace('constraints = ["shape"]', 'constraints = ["limbs"]'))
        content = called("fuse", root, *given, "with-limbs")
        bare = tmp_path / "bare"
        shutil.copytree(root, bare, symlinks=True)
    finally:
        path.write_text(text)
    asked = ["shape", "overlaps", "coarser", "returns", "limbs"]
    assert content["options"]["constraints"] == asked
    assert content["maplets"][NAME]["constraints"]["limbs"]["heights"] > 0
    states = {f"SUMFILES/{path.name}" for path in (root / "SUMFILES").glob("*.SUM")}
    assert states <= read_solution(root, "with-limbs").digests.keys()
    for shape in (bare / "SHAPEFILES").iterdir():
        shape.unlink()
    assert "leave limbs and secondary_light out" in refused("fuse", bare, *given, "none")


def test_without_stereo_constraints_alone_set_the_mean_height(mission):
    root = mission[0]
    given = ("spc", "lithos", root, "--only", NAME, "--start", "shape", "--constraint", "shape")
    called(*given, "--as", "stereo")
    content = called(*given, "--no-stereo", "--as", "no-stereo")
    assert content["options"]["stereo"] is False
    shape = Workspace.open(root).shape()
    grid = Workspace.open(root).maplet(NAME).grid
    start = shape_heights(RayCaster(shape), grid, reach=grid.radius)
    moved, kept = (
        abs(np.nanmean(Workspace.open(root, name).maplet(NAME).height - start))
        for name in ("stereo", "no-stereo")
    )
    assert kept < 0.3 * moved


def test_mapolas_that_are_coarser_than_all_maplets_are_refused(mission, tmp_path):
    root = tmp_path / "WS"
    shutil.copytree(mission[0], root, symlinks=True)
    shutil.rmtree(root / "solutions", ignore_errors=True)
    path = root / "spcola.toml"
    whole = path.read_text()
    start = whole.index("[mapolas]")
    table = whole[start:].replace("gsd_m = 0.0", "gsd_m = 2.0", 1)
    path.unlink()
    path.write_text(whole[:start] + table.replace("half_size = 0", "half_size = 10", 1))
    call("mapolas", root)
    call("register", root)
    line = refused("spc", "lithos", root, "--only", NAME, "--constraint", "lidar")
    assert "mapolas of 2 m are coarser" in line
    assert "--constraint returns" in line
    fused = called("fuse", root, "--only", NAME)
    assert [one["code"] for one in fused["remarks"]] == ["spc-errors-assumed"]
    content = called("fuse", root, "--from", "images", "--only", NAME)
    assert "returns" in content["options"]["constraints"]


def test_returns_are_taken_where_there_are_scans(mission, tmp_path):
    assert lidar_kind(Workspace.open(mission[0])) == "returns"
    call("init", tmp_path / "bare", "--spc", mission[0])
    assert lidar_kind(Workspace.open(tmp_path / "bare")) == "lidar"
