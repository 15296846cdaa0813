"""``spcola spc albedo``, through the real command line on a small synthetic mission with images."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from command_line import call, called, refused

from fusion.report.photoclinometry import gather_solved
from fusion.runtime import json_value
from fusion.service.api.schemas.solved import SolvedIndex, SolvedMaplet
from fusion.service.views.photoclinometry import solved_index, solved_maplet, solved_picture
from fusion.stages.albedo import ALBEDO_KEYS
from fusion.workspace import Workspace
from fusion.workspace.solution_records import read_solution
from spcola.formats.image_sigmas import read_albedo_sigma
from spcola.formats.maplets import read_map, read_maplet
from spcola.formats.solution import write_summary
from spcola.grids import project_maplet
from spcola.truth.body import TruthBody

# Maplets that many images show, and one near a pole.
SOME = ("TR0009", "TR0012")
POLAR = "TR0024"


@pytest.fixture(scope="module")
def root(imaged_mission, tmp_path_factory):
    """A copy of the workspace with two bigmaps over one of the maplets."""
    root = tmp_path_factory.mktemp("albedo") / "WS"
    shutil.copytree(
        imaged_mission[0], root, symlinks=True, ignore=shutil.ignore_patterns("solutions")
    )
    path = root / "spcola.toml"
    lines = path.read_text().splitlines()
    row = next(k for k, line in enumerate(lines) if line.startswith("sites ="))
    site = "latitude_deg = 2.3, longitude_deg = 218.8"
    lines[row] = (
        f'sites = [{{name = "EQ", {site}, size_m = 30.0, gsd_m = 0.75}},'
        f' {{name = "FINE", {site}, size_m = 40.0, gsd_m = 0.33}}]'
    )
    path.write_text("\n".join(lines) + "\n")
    call("fuse", root, "--only", "TR0012")
    call("bigmap", root)
    return root


def only(*names):
    return [part for name in names for part in ("--only", name)]


def albedo(path):
    """Albedo of a .MAP where images determine it, and its sigma; else NaN."""
    maplet = read_maplet(path)
    sigma = read_albedo_sigma(path.with_suffix(".ASG"), maplet.grid.half_size)
    return np.where(np.isfinite(sigma), maplet.albedo, np.nan), sigma


def truth(mission, maplet):
    """The planted albedo at the points of a maplet."""
    settings = mission[1]
    points = settings.to_spc.inverse().apply(maplet.points().reshape(-1, 3))
    known = np.isfinite(points).all(axis=1)
    found = np.full(len(points), np.nan)
    outward = points[known] / np.linalg.norm(points[known], axis=1, keepdims=True)
    found[known] = TruthBody(settings.body).albedo(outward)
    return found.reshape(maplet.height.shape)


def correlation(one, other):
    known = np.isfinite(one + other)
    return float(np.corrcoef(one[known], other[known])[0, 1])


@pytest.fixture(scope="module")
def of_maplets(root):
    return called("spc", "albedo", root, *only(*SOME, POLAR), "--as", "even")


def test_maplets_get_the_planted_albedo_and_keep_their_heights(imaged_mission, root, of_maplets):
    folder = root / "solutions" / "even" / "MAPFILES"
    for name in SOME:
        before, after = (read_map(one / f"{name}.MAP") for one in (root / "MAPFILES", folder))
        np.testing.assert_array_equal(before.maplet.height, after.maplet.height)
        assert before.header == after.header
        found, sigma = albedo(folder / f"{name}.MAP")
        planted = truth(imaged_mission, after.maplet)
        # Pixels are as wide as two cells, and slopes of the maplets wrong by five degrees.
        assert correlation(found, planted) > 0.6
        assert np.nanmean(found) == pytest.approx(1.0, abs=0.02)
        pull = (found / np.nanmean(found) - planted / np.nanmean(planted)) / sigma
        assert 0.5 < np.nanstd(pull) < 1.5
    shared = folder / "TR0001.MAP"
    assert shared.samefile(root / "MAPFILES" / "TR0001.MAP")
    record = read_solution(root, "even")
    assert (record.parent, record.made_by) == ("imported", "spcola spc albedo")
    assert record.facts["residual"] == of_maplets["residual"] < of_maplets["residual_start"]
    image = next(iter(of_maplets["images"]))
    assert {f"SUMFILES/{image}.SUM", f"IMAGEFILES/{image}.DAT"} <= set(record.digests)


def test_where_no_image_shows_lit_ground_the_albedo_is_unknown(root, of_maplets):
    path = root / "solutions" / "even" / "MAPFILES" / f"{POLAR}.MAP"
    found, sigma = albedo(path)
    share = of_maplets["surfaces"][POLAR]["share"]
    assert 0.3 < share < 0.8
    assert np.isnan(sigma).mean() == pytest.approx(1.0 - share)
    # A .MAP has no mark for it: there it is the mean.
    assert (read_maplet(path).albedo[np.isnan(found)] == 1.0).all()


def test_the_result_states_how_each_surface_and_image_fits(root, of_maplets):
    written = json.loads((root / "solutions" / "even" / "albedo.json").read_text())
    keys = {key for key in ALBEDO_KEYS if "[" not in key} - {"made_from"}
    assert set(written) == keys | {"surfaces"}
    assert written["surfaces"] == of_maplets["surfaces"]
    one = written["surfaces"][SOME[0]]
    own = {key.removeprefix("surfaces[].") for key in ALBEDO_KEYS if key.startswith("surfaces[")}
    assert set(one) == own - {"mapola", "moved_m", "center_sigma_m", "measured"}
    assert one["residual"] < one["residual_start"]
    assert 0.01 < one["sigma"] < 0.1


def test_a_second_run_writes_the_same_bytes_and_a_mean_of_a_half_halves_them(root, of_maplets):
    called("spc", "albedo", root, *only(*SOME), "--as", "again")
    half = called("spc", "albedo", root, *only(SOME[0]), "--albedo-mean", "0.5", "--as", "half")
    assert (half["options"]["albedo_mean"], half["options"]["albedo_most"]) == (0.5, 2.55)
    folder = root / "solutions"
    for name in SOME:
        for suffix in (".MAP", ".ASG"):
            one, other = (
                folder / each / "MAPFILES" / f"{name}{suffix}" for each in ("even", "again")
            )
            assert one.read_bytes() == other.read_bytes()
    path = folder / "half" / "MAPFILES" / f"{SOME[0]}.MAP"
    whole, _ = albedo(folder / "even" / "MAPFILES" / f"{SOME[0]}.MAP")
    np.testing.assert_allclose(albedo(path)[0], 0.5 * whole, atol=0.011)


def test_mapolas_become_maplets_that_correlate_with_those_from_images(root, of_maplets):
    content = called(
        "spc", "albedo", root, "--of", "mapolas", *only(*SOME, POLAR), "--letters", "LA",
        "--as", "lidar",
    )  # fmt: skip
    names = {one["mapola"]: name for name, one in content["surfaces"].items()}
    assert sorted(names.values()) == ["LA0001", "LA0002", "LA0003"]
    made = Workspace.open(root, "lidar")
    assert set(names.values()) <= set(made.maplet_names())
    assert set(names.values()) <= set(made.landmark_names())
    for mapola in SOME:
        name = names[mapola]
        assert made.mapola_names() == []
        maplet, lidar = made.maplet(name), Workspace.open(root).mapola(mapola)
        np.testing.assert_allclose(maplet.height, lidar.height, atol=4e-4, equal_nan=True)
        one = content["surfaces"][name]
        assert np.linalg.norm(one["moved_m"]) < 0.2
        assert len(one["measured"]) >= 2
        landmark = made.landmark(name)
        assert [point.name for point in landmark.pictures] == sorted(one["measured"])
        assert mapola in {overlap.name for overlap in landmark.overlaps}
        # The maplet there is the other one's neighbour too, and keeps all else that it had.
        assert name in {overlap.name for overlap in made.landmark(mapola).overlaps}
        before, after = (
            Workspace.open(root, of).landmark_path(mapola).read_text().splitlines()
            for of in ("", "lidar")
        )
        assert [line for line in after if "LA000" not in line] == before
        image = made.image(one["measured"][0])
        point = next(point for point in image.landmarks if point.name == name)
        assert (point.pixel, point.line) == (
            landmark.pictures[0].pixel, landmark.pictures[0].line,
        )  # fmt: skip
        own, _ = albedo(made.maplet_path(name))
        of_images = Workspace.open(root, "even").maplet(mapola)
        there = project_maplet(maplet.with_layers(albedo=own), of_images.grid)
        assert correlation(there.albedo, of_images.albedo) > 0.7
    assert content["surfaces"][names[POLAR]]["measured"] == []
    assert {"not-in-images"} <= {one["code"] for one in content["findings"]}
    assert not (root / "MAPFILES" / "LA0001.MAP").exists()


def test_report_and_page_show_maplets_whose_albedo_was_solved(root, of_maplets):
    made = Workspace.open(root, "even")
    index = json_value(solved_index(made))
    SolvedIndex.model_validate(index)
    assert [one["name"] for one in index["maplets"]] == [*SOME, POLAR]
    assert index["shift_m"] == of_maplets["shift_m"] > 0.0
    name = SOME[0]
    one = json_value(solved_maplet(made, name))
    SolvedMaplet.model_validate(one)
    stated = of_maplets["surfaces"][name]
    assert one["reason"].startswith("heights are kept; images determine the albedo of ")
    assert one["directions"] == []
    assert [each["albedo"] for each in one["rounds"]] == stated["changes"]
    assert [each["height_m"] for each in one["rounds"]] == [None] * len(stated["changes"])
    assert one["rounds"][0]["residual"] == one["residual_start"] > one["residual"]
    image = next(each["name"] for each in one["images"] if each["fit"] == "used")
    assert solved_picture(made, name, image)[:8] == b"\x89PNG\r\n\x1a\n"
    shown = {each.maplet.name: each for each in gather_solved(made).shown}
    assert set(shown) == {*SOME, POLAR}
    # Image, rendering and residual are there, not only the codes of what is unknown.
    assert len(np.unique(shown[name].strips[image])) > 30
    call("report", root, "--solution", "even")
    text = (root / "solutions" / "even" / "report.html").read_text()
    assert "Goodness of fit of the maplets" in text
    assert f'id="solved-{name}"' in text
    assert "heights are kept; images determine the albedo" in text


def test_a_whole_bigmap_has_one_albedo(imaged_mission, root):
    before = {path.name: path.read_bytes() for path in (root / "bigmaps").glob("*.MAP")}
    content = called("spc", "albedo", root, "--of", "bigmaps", "--rounds", 12)
    assert content["solution"] == "imported"
    assert set(content["surfaces"]) == {"EQ", "FINE"}
    folder = root / "bigmaps" / "albedo"
    for name in ("EQ", "FINE"):
        path = folder / f"{name}.MAP"
        np.testing.assert_array_equal(
            read_maplet(path).height, read_maplet(root / "bigmaps" / f"{name}.MAP").height
        )
        found, _ = albedo(path)
        assert correlation(found, truth(imaged_mission, read_maplet(path))) > 0.5
    # FINE has more cells than a window: a step at the edge of one would be seen in its rows.
    fine = albedo(folder / "FINE.MAP")[0]
    assert read_maplet(folder / "FINE.MAP").grid.size > 113
    steps = np.nanmean(np.diff(fine, axis=0)[3:-3, 3:-3], axis=1)
    assert abs(steps[len(steps) // 2]) < 4.0 * np.nanstd(steps)
    assert {path.name: path.read_bytes() for path in (root / "bigmaps").glob("*.MAP")} == before
    assert "bigmaps/EQ.MAP" in json.loads((folder / "albedo.json").read_text())["made_from"]
    assert call("bigmap", root).stdout.startswith("bigmap: up to date")
    assert (folder / "EQ.ASG").is_file()


@pytest.mark.parametrize(
    ("ground", "name"), [("maplets", SOME[0]), ("mapolas", SOME[0]), ("bigmaps", "EQ")]
)
def test_images_with_a_wrong_state_are_named(root, tmp_path, ground, name):
    copy = tmp_path / "WS"
    shutil.copytree(root, copy, symlinks=True, ignore=shutil.ignore_patterns("solutions"))
    given = ("spc", "albedo", copy, "--of", ground, "--only", name, "--rounds", "1")
    right = called(*given)
    bad = {"sun-reversed", "no-sunlit-ground", "looks-away"}
    assert not bad & {one["code"] for one in right["findings"]}
    (surface,) = right["surfaces"].values()
    seen = sorted(one for one, fit in surface["images"].items() if fit["fit"] != "not-seen")
    workspace = Workspace.open(copy)
    states = [workspace.image(one) for one in seen[:2]]
    turned = replace(states[1], axes=states[1].axes * [[1.0], [-1.0], [-1.0]])
    for state in (replace(states[0], sun=-states[0].sun), turned):
        workspace.image_path(state.name).unlink()  # a link into the mission
        write_summary(workspace.image_path(state.name), state)
    found = {one["code"]: one for one in called(*given)["findings"]}
    assert found["sun-reversed"]["names"] == [seen[0]]
    assert f"no {ground} have usable light" in found["sun-reversed"]["do"]
    assert found["looks-away"]["names"] == [seen[1]]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (["--letters", "LA"], "only mapolas get new names"),
        (["--of", "mapolas", "--letters", "L1"], "are two letters"),
        (["--of", "bigmaps", "--as", "x"], "bigmaps stay in their solution"),
        (["--of", "bigmaps", "--only", "NOWHERE"], "'NOWHERE' is not there"),
        (["--only", "XX0001"], "XX0001"),
        (["--photometry", "moonish"], "is none of"),
    ],
)
def test_what_cannot_be_done_is_refused_in_one_line(root, given, words):
    assert words in refused("spc", "albedo", root, *given)


def test_without_registration_bigmaps_or_pixels_it_says_what_to_do(imaged_mission, tmp_path):
    call("init", tmp_path / "WS", "--spc", imaged_mission[0].parent / "M" / "spc")
    given = ("spc", "albedo", tmp_path / "WS", "--of")
    assert "spcola register" in refused(*given, "mapolas")
    assert "spcola bigmap" in refused(*given, "bigmaps")
    for path in list((tmp_path / "WS" / "IMAGEFILES").iterdir()):
        path.unlink()
    assert "no image has both pixels and a state" in refused(*given, "maplets")
