"""ALTWG FITS: planes and keywords as the format has them, and every bit back."""

from __future__ import annotations

import json

import numpy as np
import pytest
from astropy.io import fits

from fusion.fusing.maplets import Source
from fusion.products.formats import read_fits_dtm, write_fits_dtm
from spcola.errors import FormatError, WorkspaceError
from spcola.grids import Maplet, MapletGrid


@pytest.fixture
def written(tmp_path, fused, provenance):
    path = tmp_path / "dtm.fits"
    write_fits_dtm(path, fused, provenance, version=4)
    return path


def altered(path, change):
    """Apply `change` to the opened file and write it again."""
    with fits.open(path, memmap=False) as units:
        change(units)
        units.writeto(path, overwrite=True)
    return path


def test_reads_back_to_the_last_bit(written, fused, assert_same) -> None:
    assert_same(read_fits_dtm(written), fused)


def test_plain_maplet_has_no_made_up_planes(tmp_path, fused, provenance, assert_same) -> None:
    plain = Maplet("SPC001", fused.grid, fused.height)
    path = tmp_path / "plain.fits"
    write_fits_dtm(path, plain, provenance, source="SPC")
    assert_same(read_fits_dtm(path), plain)
    with fits.open(path) as units:
        assert units[0].data.shape[0] == 10
        assert np.isnan(units[0].data[9]).all()
        assert "SIGMA" not in units[0].header


def test_planes_point_by_point(written, fused) -> None:
    with fits.open(written) as units:
        cube, header = units[0].data, units[0].header
    assert header["BITPIX"] == -64
    names = [header[f"PLANE{k}"] for k in range(1, 13)]
    assert names[6:] == [
        "Height relative to normal plane", "Relative albedo", "Sigma", "Quality",
        "Number of OLA points used", "Source",
    ]  # fmt: skip
    q, grid = fused.grid.half_size, fused.grid
    for m, n in (np.argwhere(fused.valid)[[0, 77, 500, 1500, -1]] - q).tolist():
        height = fused.height[m + q, n + q]
        point = grid.center + grid.gsd * (m * grid.uy + n * grid.ux) + height * grid.uz
        row, column = n + q, m + q  # rows along Ux, columns along Uy
        values = cube[:, row, column]
        np.testing.assert_allclose(values[3:6], point / 1e3, rtol=1e-15)
        np.testing.assert_allclose(values[2], np.linalg.norm(point) / 1e3, rtol=1e-15)
        np.testing.assert_allclose(values[0], np.degrees(np.arcsin(point[2] / 1e3 / values[2])))
        np.testing.assert_allclose(values[1], np.degrees(np.arctan2(point[1], point[0])))
        assert values[6] == height / 1e3
        assert values[10] == fused.count[m + q, n + q]
        assert values[11] == fused.source[m + q, n + q]


def test_quality_orders_the_sources(written, fused) -> None:
    with fits.open(written) as units:
        quality = units[0].data[9].T
    for source, wanted in {
        Source.NONE: 0, Source.FILLED: 1, Source.IMAGE: 2, Source.LIDAR: 2, Source.BOTH: 3,
    }.items():  # fmt: skip
        assert (quality[fused.source == source] == wanted).all()


def test_keywords(written, fused, provenance) -> None:
    header = fits.getheader(written)
    assert header["GSD"] == pytest.approx(350.0)
    assert header["GSDI"] == 350
    assert (header["DATASRC"], header["MAP_VER"], header["MAP_NAME"]) == ("SPO", "004", "BE0042")
    vector = [header[f"CNTR_V_{c}"] for c in "XYZ"]
    np.testing.assert_allclose(vector, fused.grid.center / 1e3, rtol=1e-15)
    np.testing.assert_allclose([header[f"UY_{c}"] for c in "XYZ"], fused.grid.uy, rtol=1e-13)
    assert header["SIGMA"] == pytest.approx(np.sqrt(np.nanmean(fused.sigma**2)))
    point = fused.grid.points(np.nan_to_num(fused.height))[0, -1]  # m = −q (left), n = q (lower)
    assert header["LLCLAT"] == pytest.approx(
        np.degrees(np.arcsin(point[2] / np.linalg.norm(point)))
    )
    assert json.loads(header["PROVENAN"]) == json.loads(provenance.text())
    assert not any("DATE" in key for key in header)


def test_usual_orientation_is_north_up(tmp_path, provenance) -> None:
    place = np.array([180.0, 60.0, 90.0])
    grid = MapletGrid.facing(place, place, 1.0, 5)
    write_fits_dtm(tmp_path / "n.fits", Maplet("N", grid, np.zeros(grid.shape)), provenance)
    header, cube = fits.getheader(tmp_path / "n.fits"), fits.getdata(tmp_path / "n.fits")
    assert header["ULCLAT"] > header["LLCLAT"]
    assert header["URCLNG"] > header["ULCLNG"]
    assert (np.diff(cube[0], axis=0) < 0).all()
    assert (np.diff(cube[1], axis=1) > 0).all()


def test_foreign_file_without_our_extensions(written, fused) -> None:
    def strip(units):
        del units[1:]
        del units[0].header["SOFTWARE"]
        cube = units[0].data
        missing = np.isnan(cube[6])
        cube[6][missing] = cube[7][missing] = 0.0
        cube[11][missing] = 0.0

    found = read_fits_dtm(altered(written, strip))
    np.testing.assert_array_equal(found.valid, fused.valid)
    np.testing.assert_allclose(found.height, fused.height, rtol=3e-16)
    np.testing.assert_allclose(found.grid.center, fused.grid.center, rtol=1e-15)


def test_same_input_gives_same_bytes(written, tmp_path, fused, provenance) -> None:
    again = tmp_path / "again" / "dtm.fits"
    again.parent.mkdir()
    write_fits_dtm(again, fused, provenance, version=4)
    assert again.read_bytes() == written.read_bytes()


@pytest.mark.parametrize(
    "key",
    ["GSD", *(f"{v}_{c}" for v in ("CNTR_V", "UX", "UY", "UZ") for c in "XYZ")],
)
def test_each_needed_keyword_missing(written, key) -> None:
    def strip(units):
        del units[1:]
        del units[0].header["SOFTWARE"]
        del units[0].header[key]

    with pytest.raises(FormatError, match=f"keyword {key}: has no number"):
        read_fits_dtm(altered(written, strip))


@pytest.mark.parametrize("plane", [7, 8, 9])
def test_each_needed_plane_missing(written, plane) -> None:
    def rename(units):
        units[0].header[f"PLANE{plane}"] = "Something else"

    with pytest.raises(FormatError, match="has no plane"):
        read_fits_dtm(altered(written, rename))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda u: u[0].data.__setitem__((11, 3, 3), 9.0), "not 0 … 4"),
        (lambda u: u[0].data.__setitem__((10, 3, 3), 1.5), "no whole number"),
        (lambda u: u[0].data.__setitem__((10, 3, 3), 1e30), "no whole number"),
        (lambda u: u[0].data.__setitem__((8, 3, 3), -1.0), "negative sigma"),
        (lambda u: u[1].data.__setitem__((3, 3), np.inf), "infinite height"),
        (lambda u: u[2].data.__setitem__((5, 0), -1.0), "must be positive"),
        (lambda u: u[2].data.__setitem__((1, 0), 3.0), "not orthonormal"),
        (lambda u: u[2].data.__setitem__((0, 0), np.nan), "not finite"),
        (lambda u: setattr(u[2], "data", np.zeros((5, 3))), "FRAME has shape"),
        (lambda u: setattr(u[1], "data", np.zeros((5, 3))), "is needed"),
        (lambda u: setattr(u[0], "data", u[0].data[:, :-1, :-1]), "odd number of rows"),
        (lambda u: setattr(u[0], "data", u[0].data[0]), "no cube"),
        (lambda u: setattr(u[0], "data", None), "no cube"),
    ],
)
def test_each_part_corrupted_once(written, fused, change, message) -> None:
    # The count of a missing point may be anything, so spoil one that has a height.
    assert np.isfinite(fused.height[3, 3])
    with pytest.raises(FormatError, match=message):
        read_fits_dtm(altered(written, change))


def test_truncated_empty_foreign_absent(written, tmp_path) -> None:
    whole = written.read_bytes()
    for length in (0, 100, 2880, len(whole) // 2):
        written.write_bytes(whole[:length])
        with pytest.raises(FormatError, match=r"dtm\.fits"):
            read_fits_dtm(written)
    written.write_bytes(b"no FITS at all\n" * 500)
    with pytest.raises(FormatError, match="cannot be read as FITS"):
        read_fits_dtm(written)
    with pytest.raises(FormatError, match="No such file"):
        read_fits_dtm(tmp_path / "absent.fits")


def test_cut_between_two_units_is_noticed(written) -> None:
    with pytest.raises(FormatError, match="cut off: FRAME is missing"):
        read_fits_dtm(altered(written, lambda units: units.pop()))


def test_folder_missing_is_one_line(tmp_path, fused, provenance) -> None:
    with pytest.raises(WorkspaceError, match="create the folder"):
        write_fits_dtm(tmp_path / "none" / "x.fits", fused, provenance)


def test_kilometres_beyond_all_numbers_are_infinite_heights(written) -> None:
    def huge(units) -> None:
        units[0].header["SOFTWARE"] = "another"
        units[0].data = units[0].data.astype(float)
        units[0].data[6] = 1e307
        del units["HEIGHT_M"]

    with pytest.raises(FormatError, match="infinite height"):
        read_fits_dtm(altered(written, huge))
