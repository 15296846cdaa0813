"""Bigmaps, their albedo and products of maplets that were solved from images.

Through the real command line on a small synthetic mission.
"""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
from astropy.io import fits
from command_line import call, called, refused

from fusion.products.formats import read_fits_dtm, read_geotiff
from fusion.workspace import Workspace
from spcola.bigmap import BigmapOptions, make_bigmap
from spcola.formats.maplets import read_maplet

SOME = ("TR0009", "TR0012")
COMPANIONS = {"map", "sigma", "albedo_sigma", "slope_sigma", "slope_directions"}
ONLY = tuple(part for name in SOME for part in ("--only", name))


@pytest.fixture(scope="module")
def root(imaged_mission, tmp_path_factory):
    """A copy with a bigmap's site over a maplet, and a solution from images, and with lidar too."""
    root = tmp_path_factory.mktemp("solved_products") / "WS"
    shutil.copytree(imaged_mission[0], root, symlinks=True)
    shutil.rmtree(root / "solutions", ignore_errors=True)
    path = root / "spcola.toml"
    lines = path.read_text().splitlines()
    row = next(k for k, line in enumerate(lines) if line.startswith("sites ="))
    site = "latitude_deg = 2.3, longitude_deg = 218.8"
    lines[row] = f'sites = [{{name = "EQ", {site}, size_m = 50.0, gsd_m = 0.75}}]'
    path.write_text("\n".join(lines) + "\n")
    call("spc", "lithos", root, *ONLY, "--start", "shape", "--as", "images")
    call("fuse", root, "--from", "images", *ONLY, "--as", "both")
    return root


@pytest.fixture(scope="module", params=["images", "both"])
def made(root, request):
    """A solution with its bigmap and its products, and what the commands printed."""
    own = ("--solution", request.param)
    return request.param, called("bigmap", root, *own), called("release", root, *own)


def test_a_bigmap_is_made_of_the_solved_maplets(root, made):
    solution, printed, _ = made
    workspace = Workspace.open(root, solution)
    (site,) = printed["summary"]["sites"]
    assert {key for key in site if key.startswith("coverage")} == {
        "coverage_solved", "coverage_maplets",
    }  # fmt: skip
    assert "the lidar is not registered: there are no bigmaps of returns" in printed["notes"]
    bigmap = read_maplet(workspace.home / "bigmaps" / "EQ.MAP")
    # TR0009 lies elsewhere; maplets around that were not solved do not count.
    table, solved = workspace.settings().bigmap, [workspace.maplet(name) for name in SOME]
    options = BigmapOptions(constraint_fraction=table.constraint_fraction, seed=table.seed)
    assert (table.max_gsd_m, table.max_distance_m) == (0.0, 0.0)
    wanted = make_bigmap("EQ", bigmap.grid, solved, options=options)
    np.testing.assert_array_equal(bigmap.valid, wanted.valid)
    known = bigmap.valid
    assert 0.2 < known.mean() < 1.0
    np.testing.assert_allclose(bigmap.height[known], wanted.height[known], atol=0.01)
    np.testing.assert_allclose(bigmap.sigma[known], wanted.sigma[known], rtol=0.02)
    every = read_maplet(workspace.home / "bigmaps" / "maplets" / "EQ.MAP")
    assert every.valid.mean() > known.mean()


def test_products_are_the_solved_maplets_and_the_bigmap(root, made):
    solution, _, printed = made
    workspace, folder = Workspace.open(root, solution), root / "solutions" / solution / "release"
    source = {"images": ("SPC", "_spc_"), "both": ("SPO", "_spo_")}[solution]
    products = json.loads((folder / "manifest.json").read_text())["products"]
    assert printed["stages"][0]["summary"]["maplets"] == 3
    assert {one["maplet"] for one in products} == {*SOME, "EQ"}
    for one in products:
        path, name = folder / one["file"], one["maplet"]
        assert "photoclinometry.json" in one["made_from"]
        assert not any(key.startswith("fused") for key in one["made_from"])
        where = "bigmaps" if name == "EQ" else "MAPFILES"
        if one["kind"] in COMPANIONS:
            assert path.read_bytes() == (workspace.home / where / path.name).read_bytes()
            continue
        assert source[1] in path.name
        maplet = read_maplet(workspace.home / where / f"{name}.MAP")
        if one["kind"] == "fits":
            found = read_fits_dtm(path)
            for layer in ("height", "sigma", "albedo"):
                np.testing.assert_array_equal(getattr(found, layer), getattr(maplet, layer))
            assert fits.getheader(path)["DATASRC"] == source[0]
        elif one["kind"] == "geotiff":
            np.testing.assert_allclose(read_geotiff(path).height, maplet.height, rtol=1e-6)
    kinds = [one["kind"] for one in products if one["maplet"] == SOME[0]]
    assert {*COMPANIONS, "fits", "geotiff"} <= set(kinds)


def test_the_albedo_of_the_bigmap_is_solved(root, made):
    content = called("spc", "albedo", root, "--solution", made[0], "--of", "bigmaps")
    assert (content["solution"], set(content["surfaces"])) == (made[0], {"EQ"})
    folder = root / "solutions" / made[0] / "bigmaps"
    np.testing.assert_array_equal(
        read_maplet(folder / "albedo" / "EQ.MAP").height, read_maplet(folder / "EQ.MAP").height
    )


def test_a_released_folder_is_assessed(imaged_mission, root, made):
    truth = imaged_mission[0].parent / "M"
    folder = root / "solutions" / made[0] / "release"
    given = ("--truth", truth, "--model", folder, "--only")
    content = called("truth", "assess", root, "--solution", made[0], *given)
    (model,) = content["models"]
    assert model["patches_there"] == 3


def test_fused_maplets_come_first(root):
    own = ("--solution", "images")
    for stage in ("mapolas", "register"):
        call(stage, root, *own)
    call("fuse", root, *own, *ONLY)
    (site,) = called("bigmap", root, *own)["summary"]["sites"]
    assert "coverage_fused" in site
    assert "coverage_returns" in site


def test_without_either_it_says_what_to_do(root):
    for command in ("bigmap", "release"):
        line = refused(command, root)
        assert f"run: spcola fuse {root}" in line
        assert "spcola spc lithos" in line
