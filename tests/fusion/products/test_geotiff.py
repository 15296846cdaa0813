"""GeoTIFF: the projection is exact on the reference plane, and the numbers come back."""

from __future__ import annotations

import json

import numpy as np
import pytest
import rasterio
from rasterio.crs import CRS
from rasterio.warp import transform as warp

from fusion.products.formats import read_geotiff, write_geotiff
from fusion.products.formats.geotiff import crs_wkt, geotransform
from spcola.errors import FormatError, InvalidValueError
from spcola.grids import Maplet, MapletGrid
from spcola.math import lon_lat_deg


@pytest.fixture
def written(tmp_path, fused, provenance):
    path = tmp_path / "dtm.tif"
    write_geotiff(path, fused, provenance)
    return path


def pixel_lon_lat(crs: CRS, grid: MapletGrid) -> tuple[np.ndarray, np.ndarray]:
    """Longitude and latitude, by PROJ, of every pixel centre, indexed as on the maplet."""
    rows, columns = np.meshgrid(range(grid.size), range(grid.size), indexing="ij")
    east, north = geotransform(grid) @ (columns + 0.5, rows + 0.5)
    sphere = CRS.from_proj4(f"+proj=longlat +R={float(grid.center @ grid.uz)!r} +no_defs")
    lon, lat = warp(crs, sphere, np.ravel(east), np.ravel(north))
    return np.reshape(lon, grid.shape).T % 360.0, np.reshape(lat, grid.shape).T


def angle_between(lon, lat, other_lon, other_lat) -> np.ndarray:
    """Small angle between directions, degrees."""
    along = (lon - other_lon + 180.0) % 360.0 - 180.0
    return np.hypot(along * np.cos(np.radians(lat)), lat - other_lat)


def grids() -> list[MapletGrid]:
    rng = np.random.default_rng(8)
    made = []
    for place in [(250, 0, 0), (0, -250, 1), (100, 90, 200), (3, 2, -240), (0, 0, 250)]:
        for tilt in (0.0, 0.6):
            uz = np.array(place) / np.linalg.norm(place) + tilt * rng.normal(size=3) / np.sqrt(3)
            usual = MapletGrid.facing(place, uz, 0.5, 30)
            angle = rng.uniform(0, 2 * np.pi)
            ux = np.cos(angle) * usual.ux + np.sin(angle) * usual.uy
            made.append(MapletGrid(place, [ux, np.cross(usual.uz, ux), usual.uz], 0.5, 30))
    return made


@pytest.mark.parametrize("grid", grids(), ids=lambda grid: f"{grid.center}{grid.uz.round(1)}")
def test_reference_plane_is_exact_whatever_the_tilt(grid) -> None:
    lon, lat = pixel_lon_lat(CRS.from_wkt(crs_wkt(grid, "Bennu")), grid)
    true_lon, true_lat = lon_lat_deg(grid.points(np.zeros(grid.shape)))
    # 1e-9 degree is 4 nm on a body of 250 m: what doubles leave.
    assert angle_between(lon, lat, true_lon, true_lat).max() < 1e-9


def test_surface_is_displaced_as_stated(fused) -> None:
    grid, height = fused.grid, 1.3
    points = grid.points(np.full(grid.shape, height)).reshape(-1, 3)
    distance = grid.center @ grid.uz
    foot = distance * grid.uz
    on_plane = points - height * grid.uz
    rho = np.linalg.norm(on_plane - foot, axis=1)
    apparent = foot + (on_plane - foot) * (distance / (distance + height))
    np.testing.assert_allclose(np.cross(apparent, points), 0.0, atol=1e-9)  # one direction
    np.testing.assert_allclose(
        np.linalg.norm(apparent - on_plane, axis=1), rho * height / (distance + height)
    )


def test_written_crs_and_transform_survive_the_file(written, fused) -> None:
    with rasterio.open(written) as raster:
        assert raster.crs.is_projected
        assert raster.crs.linear_units == "metre"
        assert raster.transform.almost_equals(geotransform(fused.grid), precision=1e-9)
        lon, lat = pixel_lon_lat(raster.crs, fused.grid)
    true_lon, true_lat = lon_lat_deg(fused.grid.points(np.zeros(fused.grid.shape)))
    assert angle_between(lon, lat, true_lon, true_lat).max() < 1e-9


def test_usual_orientation_is_north_up() -> None:
    place = np.array([150.0, 60.0, 90.0])
    affine = geotransform(MapletGrid.facing(place, place, 0.25, 10))
    np.testing.assert_allclose(affine[:6], [0.25, 0, -2.625, 0, -0.25, 2.625], atol=1e-9)


def test_area_is_not_mirrored(fused) -> None:
    affine = geotransform(fused.grid)
    assert affine.determinant == pytest.approx(-(fused.grid.gsd**2))


def test_reads_back_within_single_precision(written, fused, assert_same) -> None:
    single = fused.with_layers(
        **{k: getattr(fused, k).astype(np.float32) for k in ("height", "sigma", "albedo")}
    )
    assert_same(read_geotiff(written), single)


def test_plain_maplet(tmp_path, fused, provenance, assert_same) -> None:
    plain = Maplet("SPC001", fused.grid, fused.height.astype(np.float32))
    write_geotiff(tmp_path / "p.tif", plain, provenance)
    assert_same(read_geotiff(tmp_path / "p.tif"), plain)


def test_tiled_described_with_overviews(written, provenance) -> None:
    with rasterio.open(written) as raster:
        assert raster.profile["tiled"]
        assert raster.block_shapes[0] == (256, 256)
        assert raster.descriptions == ("height", "sigma", "albedo", "count", "source")
        assert "returns" in raster.tags(4)["DESCRIPTION"]
        assert np.isnan(raster.nodata)
        assert raster.overviews(1) == [2]
        assert json.loads(raster.tags()["SPCOLA_PROVENANCE"]) == json.loads(provenance.text())


def test_overviews_hold_true_points(tmp_path, provenance, make_fused) -> None:
    large = make_fused(half_size=300)
    write_geotiff(tmp_path / "l.tif", large, provenance)
    with rasterio.open(tmp_path / "l.tif") as raster:
        assert raster.overviews(1) == [2, 4, 8, 16]
    with rasterio.open(tmp_path / "l.tif", overview_level=1) as raster:
        assert set(np.unique(raster.read(5))) == {0, 1, 2, 3, 4}


def test_same_input_gives_same_bytes(written, tmp_path, fused, provenance) -> None:
    again = tmp_path / "again.tif"
    write_geotiff(again, fused, provenance)
    assert again.read_bytes() == written.read_bytes()


def test_plane_through_the_origin_has_no_projection(fused, provenance, tmp_path) -> None:
    grid = MapletGrid([0.0, 0.0, -250.0], np.eye(3), 1.0, 5)
    with pytest.raises(InvalidValueError, match="does not face away"):
        write_geotiff(tmp_path / "x.tif", Maplet("X", grid, np.zeros(grid.shape)), provenance)
    assert list(tmp_path.iterdir()) == []


def test_foreign_truncated_absent(written, tmp_path) -> None:
    whole = written.read_bytes()
    for length in (0, 7, 300, len(whole) // 3):
        written.write_bytes(whole[:length])
        with pytest.raises(FormatError, match=r"dtm\.tif"):
            read_geotiff(written)
    with pytest.raises(FormatError, match="cannot be read as GeoTIFF"):
        read_geotiff(tmp_path / "absent.tif")
    foreign = tmp_path / "foreign.tif"
    with rasterio.open(
        foreign, "w", driver="GTiff", width=3, height=3, count=1, dtype="float32",
        transform=rasterio.Affine(1, 0, 5, 0, -1, 5),
    ) as raster:  # fmt: skip
        raster.write(np.zeros((1, 3, 3), np.float32))
    with pytest.raises(FormatError, match="not written by spcola"):
        read_geotiff(foreign)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: r.update_tags(SPCOLA_FRAME="{"), "does not describe a maplet grid"),
        (lambda r: r.update_tags(SPCOLA_FRAME='{"name":"A"}'), "does not describe a maplet grid"),
        (lambda r: r.set_band_description(1, "elevation"), "has bands elevation"),
        (lambda r: r.write(np.full(r.shape, 7.0, np.float32), 5), "not 0 … 4"),
        (lambda r: r.write(np.full(r.shape, -7.0, np.float32), 4), "negative count"),
        (lambda r: r.write(np.full(r.shape, np.inf, np.float32), 1), "infinite"),
    ],
)
def test_each_part_corrupted_once(written, change, message) -> None:
    with rasterio.open(written, "r+") as raster:
        change(raster)
    with pytest.raises(FormatError, match=message):
        read_geotiff(written)
