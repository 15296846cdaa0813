"""Heights of mapolas as constraints of a fused maplet."""

from __future__ import annotations

import numpy as np
import pytest
from fused_scene import GRID, SIZE, correlated, rms, truth
from scipy import ndimage

from fusion.fusing import (
    FuseInput,
    RegisteredMapola,
    fuse_maplet,
    lidar_constraints,
)
from fusion.fusing.maplets import Source
from fusion.fusing.uncertainty import (
    SlopeInformation,
)
from lidar.gridding import Mapola
from spcola.grids import Maplet, MapletGrid


def candidate(mapola):
    return RegisteredMapola(mapola.grid, lambda: mapola)


def test_constraints_take_one_mapola_for_each_point():
    low = Mapola(
        "A",
        GRID,
        np.zeros(GRID.shape),
        sigma=np.full(GRID.shape, 0.02),
        count=np.full(GRID.shape, 3),
    )
    gap = np.zeros(GRID.shape)
    gap[:, :20] = np.nan
    first = Mapola(
        "B", GRID, gap + 1.0, sigma=np.full(GRID.shape, 0.01), count=np.where(np.isnan(gap), 0, 7)
    )
    found = lidar_constraints(GRID, [candidate(first), candidate(low)])
    # A cell next to the gap has an unknown corner, so that its edge comes from the other mapola.
    assert np.all(found.height[1:-1, 22:-1] == pytest.approx(1.0))
    assert np.all(found.height[1:-1, 1:18] == pytest.approx(0.0))
    assert np.all(found.count[1:-1, 22:-1] == 7)
    assert np.all(found.count[1:-1, 1:18] == 3)
    far = MapletGrid(-GRID.center, GRID.axes * np.array([[1.0], [-1.0], [-1.0]]), 0.5, 30)
    assert np.isnan(lidar_constraints(far, [candidate(low)]).height).all()


@pytest.mark.parametrize("away", [0.0, 0.25, 0.5])
def test_means_of_cells_are_blurred_by_these_and_by_interpolation(away):
    """A dome whose mapola lies some cells off: means over a cell, straight lines between them."""
    dome = 0.04
    center = GRID.center + away * GRID.gsd * (GRID.axes[0] + GRID.axes[1])
    other = MapletGrid(center, GRID.axes, GRID.gsd, GRID.half_size)
    x, y = GRID.gsd * np.array(np.meshgrid(GRID.offsets, GRID.offsets))
    means = -dome * ((x + away * GRID.gsd) ** 2 + (y + away * GRID.gsd) ** 2)
    means -= 2.0 * dome * GRID.gsd**2 / 12.0
    # More noise than bending: heights at points stay means, and are too low.
    layers = {"sigma": np.full(GRID.shape, 0.02), "count": np.full(GRID.shape, 5)}
    mapola = Mapola("A", other, means, **layers)
    found = lidar_constraints(GRID, [candidate(mapola)], as_means=True)
    known = np.isfinite(found.height)
    assert known.mean() > 0.9
    variance = GRID.gsd**2 * (1.0 / 12.0 + away * (1.0 - away))
    np.testing.assert_allclose(found.blur[known], variance, rtol=1e-6)
    true = -dome * (x**2 + y**2)
    np.testing.assert_allclose(
        found.height[known], (true - 0.5 * variance * 4.0 * dome)[known], atol=1e-9
    )
    assert lidar_constraints(GRID, [candidate(mapola)]).blur is None


def test_a_mapola_that_is_not_needed_is_not_read():
    full = Mapola(
        "A",
        GRID,
        np.zeros(GRID.shape),
        sigma=np.full(GRID.shape, 0.02),
        count=np.full(GRID.shape, 3),
    )
    inner = MapletGrid(GRID.center, GRID.axes, 0.5, 20)

    def refuse():
        raise AssertionError("read for nothing")

    found = lidar_constraints(inner, [candidate(full), RegisteredMapola(GRID, refuse)])
    assert np.isfinite(found.height).all()


def coarse_mapola(surface, factor, sigma, generator):
    """Means of a surface over squares of `factor` points, as a mapola of that GSD."""
    half = (SIZE // factor - 1) // 2
    grid = MapletGrid(GRID.center, GRID.axes, factor * GRID.gsd, half)
    size = factor * grid.size
    first = (SIZE - size) // 2
    inner = surface[first : first + size, first : first + size]
    mean = inner.reshape(grid.size, factor, grid.size, factor).mean(axis=(1, 3))
    mean = mean + sigma * generator.normal(size=mean.shape)
    layers = {"sigma": np.full(grid.shape, sigma), "count": np.full(grid.shape, 9)}
    return Mapola("C", grid, mean, **layers)


def test_cells_of_a_coarse_mapola_hold_means_and_leave_the_detail_to_the_slopes():
    generator = np.random.default_rng(31)
    surface = truth(generator)
    mapola = coarse_mapola(surface, 5, 0.02, generator)
    found = lidar_constraints(GRID, [candidate(mapola)])
    assert not np.isfinite(found.height).any()
    assert found.means is not None
    inside = np.isfinite(found.coarse)
    assert np.mean(inside) > 0.6
    spc = surface + correlated(generator, 0.15, 12.0)
    parts = FuseInput(
        "AA0001",
        GRID,
        Maplet("AA0001", GRID, spc),
        found,
        ndimage.gaussian_filter(surface, 8.0),
        np.zeros((3, 3)),
    )
    # The slow error of 15 cm differs by 2.6 cm over three cells: see walk_sigma.
    information = SlopeInformation(0.03, 0.0, 0.0, 0.15, 400.0)
    fused = fuse_maplet(parts, information).maplet
    assert np.all(fused.source[inside] == Source.BOTH)
    error = fused.height - surface
    # Better than SPC, whose slow errors the means take out, and than the coarse cells themselves,
    # between which the detail is lost.
    assert rms(error[inside]) < 0.5 * rms((spc - surface)[inside])
    assert rms(error[inside]) < 0.5 * rms((found.coarse - surface)[inside])
    # Detail is that of the steps: the roughness of the surface is not flattened.
    assert rms(np.diff(error, axis=1)[:, 5:-5]) < 0.15 * rms(np.diff(surface, axis=1))
    assert 0.55 < np.mean(np.abs(error)[inside] < fused.sigma[inside]) < 0.95


def test_points_with_a_height_of_their_own_are_in_no_mean():
    generator = np.random.default_rng(32)
    surface = truth(generator)
    fine = np.where(np.arange(SIZE) < 30, surface, np.nan)
    layers = {"sigma": np.full(GRID.shape, 0.02), "count": np.where(np.isfinite(fine), 5, 0)}
    own = Mapola("B", GRID, fine, **layers)
    coarse = coarse_mapola(surface, 4, 0.02, generator)
    found = lidar_constraints(GRID, [candidate(own), candidate(coarse)])
    assert np.isfinite(found.height[:, :30]).all()
    assert not np.isfinite(found.coarse[:, :30]).any()
    held = np.zeros(SIZE * SIZE, dtype=bool)
    held[found.means.points] = True
    assert np.array_equal(held.reshape(GRID.shape), np.isfinite(found.coarse))
    np.testing.assert_allclose(np.add.reduceat(found.means.share, found.means.start[:-1]), 1.0)
