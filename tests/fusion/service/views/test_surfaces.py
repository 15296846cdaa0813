"""Surfaces of a workspace, read part by part, are those that are read as a whole."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.fusing.maplets import read_fused
from fusion.pipeline import Pipeline
from fusion.service.views.outlines import same_place
from fusion.service.views.surfaces import (
    LayerCache,
    SurfaceKind,
    open_surface,
    surface_names,
    value_at,
)
from fusion.stages.release import STAGE
from spcola.errors import FormatError, InvalidValueError, WorkspaceError
from spcola.formats.maplets import MapParts, read_maplet, sigma_path, write_maplet
from spcola.grids import Maplet, MapletGrid


def whole(surface, layer):
    size = (0, surface.grid.size)
    return surface.window(layer, rows=size, columns=size)


def test_each_kind_has_its_names_and_layers(workspace) -> None:
    Pipeline(workspace, workspace.settings(), [STAGE]).run_stage("release")
    names = {kind: surface_names(workspace, kind) for kind in SurfaceKind}
    maplets = ["AA0000", "AA0001", "AA0002"]
    assert names == {
        "maplet": maplets, "mapola": [], "fused": maplets, "pair": [],
        "bigmap": ["SITE:fused", "SITE:spc"], "dtm": [*maplets, "SITE"],
    }  # fmt: skip
    for kind, name, more in (
        (SurfaceKind.MAPLET, "AA0001", {"albedo"}),
        (SurfaceKind.FUSED, "AA0001", {"sigma", "albedo", "count", "source", "difference"}),
        # No return lies in the cells of the first.
        (SurfaceKind.FUSED, "AA0000", {"sigma", "albedo", "source", "difference"}),
        (SurfaceKind.BIGMAP, "SITE:spc", {"sigma"}),
        (SurfaceKind.BIGMAP, "SITE:fused", {"sigma", "difference"}),
        (SurfaceKind.DTM, "AA0001", {"sigma", "albedo", "count", "source", "difference"}),
    ):
        surface = open_surface(workspace, kind, name)
        assert set(surface.layers) == {"height", "hillshade", "slope", *more}
        described = surface.describe()
        assert described["gsd_m"] == pytest.approx(0.5)
        assert [each["name"] for each in described["layers"]] == list(surface.layers)
    alike = same_place(workspace, SurfaceKind.BIGMAP, "SITE:spc")
    assert alike == [("bigmap", "SITE:fused"), ("bigmap", "SITE:spc"), ("dtm", "SITE")]
    with pytest.raises(WorkspaceError, match="there is no maplet"):
        open_surface(workspace, SurfaceKind.MAPLET, "../MAPFILES/AA0001")
    with pytest.raises(InvalidValueError, match="has no layer 'count'"):
        whole(open_surface(workspace, SurfaceKind.MAPLET, "AA0001"), "count")


def test_differences_are_those_of_the_surfaces_whatever_their_grids(workspace) -> None:
    fused = open_surface(workspace, SurfaceKind.FUSED, "AA0001")
    # The fused ball is 0.2 m larger, on another grid; along Uz at its rim a little more.
    middle = value_at(fused, 0.0, 0.0)["layers"]["difference"]
    assert middle == pytest.approx(0.2, abs=5e-4)
    difference = whole(fused, "difference")
    across = np.hypot(*np.meshgrid(*(2 * [0.5 * np.arange(-12.0, 13.0)])))
    wanted = np.sqrt(60.2**2 - across**2) - np.sqrt(60.0**2 - across**2)
    known = np.isfinite(difference)
    assert known[5:-5, 5:-5].all()
    np.testing.assert_allclose(difference[known], wanted[known], atol=1.2e-3)
    site = open_surface(workspace, SurfaceKind.BIGMAP, "SITE:fused")
    assert np.median(whole(site, "difference")) == pytest.approx(0.1, abs=1e-3)


def test_parts_of_files_are_those_of_the_whole(workspace, tmp_path) -> None:
    rng = np.random.default_rng(3)
    # Large enough to be memory mapped.
    grid = MapletGrid.facing([0.0, 300.0, 0.0], [0.0, 1.0, 0.1], 0.2, 760)
    height = rng.normal(size=grid.shape)
    height[rng.random(grid.shape) < 0.1] = np.nan
    sigma = np.where(np.isfinite(height), rng.uniform(0.01, 0.2, grid.shape), np.nan)
    albedo = rng.uniform(0.5, 2.0, grid.shape)
    path = tmp_path / "BIG.MAP"
    write_maplet(path, Maplet("BIG", grid, height, albedo, sigma), sigma_companion=True)
    wanted = read_maplet(path)
    index = (slice(30, 700), slice(900, 905))
    places = (np.array([3, 1500, 7]), np.array([0, 1520, 7]))
    for swapped in (False, True):
        if swapped:
            content = np.fromfile(sigma_path(path), ">f4").astype("<f4")
            sigma_path(path).write_bytes(content.tobytes())
        parts = MapParts.open(path)
        for layer in ("height", "albedo", "sigma"):
            for part in (index, places):
                np.testing.assert_array_equal(
                    parts.read(layer, part), getattr(wanted, layer)[part], err_msg=layer
                )
    sigma_path(path).write_bytes(np.full(grid.size**2, 7e30, "<f4").tobytes())
    with pytest.raises(FormatError, match="no sigma in kilometres"):
        MapParts.open(path).read("sigma", index)
    stored = open_surface(workspace, SurfaceKind.FUSED, "AA0002")
    fused = read_fused(workspace.root / "fused", "AA0002")
    for layer in ("height", "albedo", "count"):
        window = stored.window(layer, rows=(3, 9), columns=(20, 25))
        np.testing.assert_allclose(window, getattr(fused, layer).T[3:9, 20:25], rtol=1e-7)


def test_a_changed_file_is_read_again(workspace) -> None:
    cache, path = LayerCache(), workspace.maplet_path("AA0001")
    grid = MapletGrid.facing([60.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.5, 200)
    tags = set()
    for lift in (1.0, 2.0):
        write_maplet(path, Maplet("AA0001", grid, np.full(grid.shape, lift)))
        surface = open_surface(workspace, SurfaceKind.MAPLET, "AA0001", cache=cache)
        assert np.unique(surface.tile("height", 2, 0, 0)[:200, :200]) == pytest.approx([lift])
        tags.add(surface.etag)
    assert len(tags) == 2


def test_the_cache_drops_what_was_used_longest_ago() -> None:
    made = []

    def make(name):
        made.append(name)
        return {"": np.zeros(100)}

    cache = LayerCache(2000)
    for name in "abacab":
        cache.find(name, "", lambda name=name: make(name))
    assert made == ["a", "b", "c", "b"]
