"""Terrain models of others: projections, datums, units and gaps, against a surface by formula."""

from __future__ import annotations

import numpy as np
import pytest
import rasterio
from affine import Affine
from rasterio.crs import CRS
from rasterio.warp import transform as warp

from fusion.products.formats import TerrainRaster, write_geotiff
from spcola.errors import FormatError
from spcola.grids import Maplet, MapletGrid

RADIUS = 100.0
# Ordinary ground; across longitude 180; across longitude 0; near a pole.
PLACES = ([80.0, 20.0, 10.0], [-80.0, -2.0, 10.0], [80.0, -0.1, 10.0], [5.0, 3.0, 99.0])


def from_origin(west, north, across, down):
    return Affine(across, 0.0, west, 0.0, -down, north)


def height(longitude, latitude):
    return 1.5 * np.sin(9.0 * longitude) * np.cos(7.0 * latitude) + 0.3


def written(path, crs, transform, shape, *, axes=(RADIUS, RADIUS), form=None, **profile):
    """Write heights at the middles of pixels; `form` changes them."""
    rows, columns = np.mgrid[: shape[0], : shape[1]] + 0.5
    x, y = transform @ (columns.ravel(), rows.ravel())
    crs = CRS.from_user_input(crs)
    sphere = CRS.from_proj4(f"+proj=longlat +a={axes[0]} +b={axes[1]} +no_defs")
    longitude, latitude = np.radians(warp(crs, sphere, x, y))
    values = height(longitude, latitude).reshape(shape)
    values = (form or (lambda v: v))(values)
    with rasterio.open(
        path, "w", driver="GTiff", width=shape[1], height=shape[0], count=1, dtype="float32",
        crs=crs, transform=transform, nodata=-9999.0,
    ) as raster:  # fmt: skip
        raster.write(np.where(np.isnan(values), -9999.0, values).astype(np.float32), 1)
        for key, value in profile.items():
            setattr(raster, key, (value,))
    return path


def facing(place):
    """A start at the sphere around a place, tilted by seven degrees."""
    up = np.array(place) / np.linalg.norm(place)
    grid = MapletGrid.facing(RADIUS * up, up + np.array([0.1, 0.05, 0.0]), 0.5, 20)
    return Maplet("A", grid, np.zeros(grid.shape))


def errors(found, start, *, axes=(RADIUS, RADIUS)):
    """Heights above the spheroid less those of the formula."""
    places = start.grid.points(found)
    spheroid = TerrainRaster(None, *axes, False, 1.0, 0.0, 1.0)
    longitude, latitude, above = spheroid.geodetic(places)
    return above - height(longitude, latitude)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The whole body, longitudes 0 to 360, finer than the grid."""
    path = tmp_path_factory.mktemp("maps") / "whole.tif"
    crs = f"+proj=longlat +R={RADIUS} +no_defs"
    return written(path, crs, from_origin(0.0, 90.0, 0.1, 0.1), (1800, 3600))


@pytest.mark.parametrize("place", PLACES)
def test_heights_are_those_of_the_map_everywhere(whole, place):
    start = facing(place)
    found = TerrainRaster.open(whole).heights(start)
    # Beyond the last pixel before a pole there is none.
    assert np.isfinite(found).mean() > 0.995
    assert np.nanmax(np.abs(errors(found, start))) < 0.003


@pytest.mark.parametrize(
    ("crs", "transform", "shape", "place"),
    [
        ("+proj=eqc +R=100 +lon_0=0 +lat_ts=0 +units=m", (-314.159265, 157.0796, 0.25, 0.25),
         (1256, 2513), PLACES[1]),
        ("+proj=stere +R=100 +lat_0=90 +lon_0=30 +units=m", (-60.0, 60.0, 0.2, 0.2), (600, 600),
         [15.0, 3.0, 97.0]),
        ("+proj=stere +R=100 +lat_0=90 +lon_0=30 +units=km", (-0.06, 0.06, 2e-4, 2e-4), (600, 600),
         [15.0, 3.0, 97.0]),
    ],
)  # fmt: skip
def test_projections_are_understood(tmp_path, crs, transform, shape, place):
    path = written(tmp_path / "map.tif", crs, from_origin(*transform), shape)
    start = facing(place)
    found = TerrainRaster.open(path).heights(start)
    assert np.isfinite(found).mean() > 0.97
    # Between pixels the ground is bent where meridians come together.
    wrong = np.abs(errors(found, start))
    assert np.nanmedian(wrong) < 0.006
    assert np.nanmax(wrong) < 0.04


def test_heights_above_a_spheroid_are_along_its_normal(tmp_path):
    axes = (100.0, 80.0)
    crs = "+proj=longlat +a=100 +b=80 +no_defs"
    path = written(
        tmp_path / "map.tif", crs, from_origin(-180.0, 90.0, 0.1, 0.1), (1800, 3600), axes=axes
    )
    start = facing([70.0, 20.0, 55.0])
    terrain = TerrainRaster.open(path)
    assert (terrain.equator, terrain.pole) == pytest.approx(axes)
    found = terrain.heights(start)
    assert np.isfinite(found).all()
    assert np.abs(errors(found, start, axes=axes)).max() < 0.003


def test_units_scales_and_radii(tmp_path):
    crs, transform = f"+proj=longlat +R={RADIUS} +no_defs", from_origin(0.0, 60.0, 0.2, 0.2)
    given = [
        ({"units": "km"}, lambda v: v / 1000.0),
        ({"scales": 0.5, "offsets": -10.0}, lambda v: 2.0 * (v + 10.0)),
        ({}, lambda v: v + RADIUS),
    ]
    for number, (profile, form) in enumerate(given):
        path = written(tmp_path / f"{number}.tif", crs, transform, (600, 900), form=form, **profile)
        start = facing(PLACES[0])
        found = TerrainRaster.open(path).heights(start)
        assert np.isfinite(found).all()
        assert np.abs(errors(found, start)).max() < 0.01


def test_finer_pixels_are_averaged_and_gaps_stay_gaps(tmp_path):
    crs = f"+proj=longlat +R={RADIUS} +no_defs"
    rng = np.random.default_rng(1)

    def noisy(values):
        values = values + rng.normal(0.0, 0.5, values.shape)
        values[:, 900:] = np.nan
        return values

    path = written(
        tmp_path / "fine.tif", crs, from_origin(5.0, 15.0, 0.02, 0.02), (900, 1500), form=noisy
    )
    start = facing(PLACES[0])
    found = TerrainRaster.open(path).heights(start)
    known = np.isfinite(found)
    # Fourteen pixels a grid step: noise of 0.5 m falls to 0.04 m; the map ends at longitude 23°.
    assert np.std(errors(found, start)[known]) < 0.06
    longitude = np.degrees(TerrainRaster.open(path).geodetic(start.grid.points(start.height))[0])
    assert known[(longitude > 10.0) & (longitude < 22.0)].mean() > 0.95
    assert not known[longitude > 23.5].any()


def test_one_of_a_release_is_a_maplet(tmp_path, fused, provenance):
    write_geotiff(tmp_path / "dtm.tif", fused, provenance)
    found = TerrainRaster.open(tmp_path / "dtm.tif")
    assert isinstance(found, Maplet)
    assert found.name == fused.name


def test_what_is_no_terrain_model_is_refused_in_one_line(tmp_path):
    crs, transform = f"+proj=longlat +R={RADIUS} +no_defs", from_origin(0.0, 10.0, 0.2, 0.2)
    written(tmp_path / "feet.tif", crs, transform, (20, 20), units="feet")
    written(tmp_path / "empty.tif", crs, transform, (20, 20), form=lambda v: np.nan * v)
    with rasterio.open(
        tmp_path / "image.tif", "w", driver="GTiff", width=9, height=9, count=1, dtype="uint8",
        transform=transform,
    ) as raster:  # fmt: skip
        raster.write(np.ones((9, 9), dtype=np.uint8), 1)
    (tmp_path / "cut.tif").write_bytes((tmp_path / "feet.tif").read_bytes()[:300])
    for name, words in (
        ("feet.tif", "has heights in 'feet'"),
        ("empty.tif", "has no height"),
        ("image.tif", "states no projection"),
        ("cut.tif", "cannot be read as GeoTIFF"),
    ):
        with pytest.raises(FormatError, match=words):
            TerrainRaster.open(tmp_path / name)
