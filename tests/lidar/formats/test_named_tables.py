"""Tables whose header names columns and units."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lidar.formats import recognise
from lidar.formats.reader import read_scan
from lidar.formats.records import LidarOptions
from spcola.errors import FormatError
from spcola.navigation import et_from_utc

RNG = np.random.default_rng(3)
POINTS = RNG.normal(size=(12, 3)) * 250.0
CRAFT = POINTS + RNG.normal(size=(12, 3)) * 700.0
RANGE = np.linalg.norm(POINTS - CRAFT, axis=1)


def write(path: Path, header: list[str], table: np.ndarray, separator: str = ",") -> Path:
    rows = [separator.join(repr(float(value)) for value in row) for row in table]
    path.write_text("\n".join([separator.join(header), *rows]) + "\n")
    return path


FULL = np.column_stack([POINTS, CRAFT, RANGE, 6e8 + np.arange(12.0), np.arange(12.0)])
HEADER = ["x_m", "y_m", "z_m", "scx_m", "scy_m", "scz_m", "range_m", "time_et_s", "flag"]


@pytest.mark.parametrize("separator", [",", ";", "\t", " "])
def test_names_and_units_are_read(tmp_path: Path, separator: str) -> None:
    path = write(tmp_path / "a.any", HEADER, FULL, separator)
    assert recognise(path) == "table"
    scan = read_scan(path)
    np.testing.assert_array_equal(scan.points, POINTS)
    np.testing.assert_array_equal(scan.spacecraft, CRAFT)
    np.testing.assert_array_equal(scan.range, RANGE)
    np.testing.assert_array_equal(scan.time, FULL[:, 7])
    np.testing.assert_array_equal(scan.flag, np.arange(12))
    assert np.isnan(scan.sigma).all()


@pytest.mark.parametrize("form", ["{}_km", "{} [km]", "{} (km)", "{}[KM]"])
def test_units_are_converted(tmp_path: Path, form: str) -> None:
    header = [form.format(name) for name in "XYZ"]
    scan = read_scan(write(tmp_path / "a", header, POINTS / 1e3))
    np.testing.assert_allclose(scan.points, POINTS, rtol=1e-14)
    assert np.isnan(scan.range).all()


def test_spherical_positions(tmp_path: Path) -> None:
    radius = np.linalg.norm(POINTS, axis=1)
    lon = np.degrees(np.arctan2(POINTS[:, 1], POINTS[:, 0]))
    lat = np.degrees(np.arcsin(POINTS[:, 2] / radius))
    header = ["lon_deg", "latitude (deg)", "radius_km"]
    table = np.column_stack([lon, lat, radius / 1e3])
    np.testing.assert_allclose(
        read_scan(write(tmp_path / "a", header, table)).points, POINTS, atol=1e-10
    )
    both = np.column_stack([table, POINTS])
    both[5, 1] += 45.0
    scan = read_scan(write(tmp_path / "b", [*header, "x_m", "y_m", "z_m"], both))
    assert dict(scan.rejected) == {"coordinates disagree": 1}


def test_utc_column(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_text(
        "utc,x_m,y_m,z_m,sigma_cm\n2019-02-08T12:00:00.5,1,2,3,4\n2019-02-08T12:00:01Z,1,2,3,5\n"
        "2019-13-08T12:00:01,1,2,3,5\nyesterday,1,2,3,5\n"
    )
    # Rows of that kind are a track's, were it not for the header.
    assert recognise(path) == "table"
    scan = read_scan(path)
    assert dict(scan.rejected) == {"not finite": 2}
    np.testing.assert_allclose(scan.time[0], et_from_utc("2019-02-08T12:00:00.5"))
    np.testing.assert_allclose(scan.sigma, [0.04, 0.05])


@pytest.mark.parametrize(
    "columns",
    [
        {"x": "X [km]", "y": "Y [km]", "z": "Z [km]"},
        {"x": "X [km]", "y": "Y", "z": "Z_km"},
    ],
)
def test_columns_may_be_chosen(tmp_path: Path, columns: dict[str, str]) -> None:
    header = ["id", "X [km]", "Y", "Z_km"]
    if columns["y"] == "Y":
        header[2] = "Y"
        columns = {**columns, "y": "Y [km]"}
    else:
        header[2:] = ["Y [km]", "Z [km]"]
    table = np.column_stack([np.arange(12.0), POINTS / 1e3])
    path = write(tmp_path / "a", header, table)
    options = LidarOptions(columns=columns)
    scan = read_scan(path, format="table", options=options)
    np.testing.assert_allclose(scan.points, POINTS, rtol=1e-14)


@pytest.mark.parametrize("index", range(8))
def test_a_column_without_a_unit_is_refused(tmp_path: Path, index: int) -> None:
    header = list(HEADER)
    header[index] = header[index].split("_")[0]
    with pytest.raises(FormatError, match=r"a, line 1: column '\w+' has no unit, .*; name it"):
        read_scan(write(tmp_path / "a", header, FULL))


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (["x_m", "y_m", "z_deg"], "column 'z_deg' is in 'deg'"),
        (["x_m", "y_m", "z_s"], "column 'z_s' is in 's'"),
        (["x_m", "y_m", "w_m"], "no x, y, z"),
        (["x_m", "y_m", "X [km]"], "repeats x"),
        (["a", "b", "c"], "no x, y, z"),
    ],
)
def test_bad_headers(tmp_path: Path, header: list[str], message: str) -> None:
    with pytest.raises(FormatError, match=message):
        read_scan(write(tmp_path / "a", header, POINTS), format="table")


def test_part_of_a_vector_is_refused(tmp_path: Path) -> None:
    header = ["x_m", "y_m", "z_m", "scx_m"]
    with pytest.raises(FormatError, match="scx but no scy, scz"):
        read_scan(write(tmp_path / "a", header, FULL[:, :4]))


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"x": "q [m]"}, "has no column 'q'"),
        ({"x": "x_m"}, "has x but|column x but no y, z|no x, y, z"),
        ({"depth": "x_m"}, "'depth' is no quantity"),
        ({"x": "x_m", "y": "y_m", "z": "flag"}, "has no unit"),
    ],
)
def test_bad_choices(tmp_path: Path, columns: dict[str, str], message: str) -> None:
    path = write(tmp_path / "a", HEADER, FULL)
    with pytest.raises(FormatError, match=message):
        read_scan(path, options=LidarOptions(columns=columns))


@pytest.mark.parametrize("index", [0, 1, 2, 3, 4, 5, 6])
def test_a_column_in_another_unit_refuses_the_table(tmp_path: Path, index: int) -> None:
    table = FULL.copy()
    table[:, index] *= 1e3
    with pytest.raises(FormatError, match=r"contradict themselves.*units"):
        read_scan(write(tmp_path / "a", HEADER, table))


@pytest.mark.parametrize("garbage", ["nan", "inf", "1e40", "x", "", "1_0"])
def test_each_field_garbled_once_is_counted(tmp_path: Path, garbage: str) -> None:
    path = write(tmp_path / "a", HEADER, FULL)
    good = path.read_text().split("\n")
    for index in range(9):
        fields = good[6].split(",")
        fields[index] = garbage
        path.write_text("\n".join([*good[:6], ",".join(fields), *good[7:]]))
        scan = read_scan(path)
        assert (len(scan), sum(scan.rejected.values())) == (11, 1), index
        np.testing.assert_array_equal(scan.points, np.delete(POINTS, 5, axis=0))


def test_zero_and_negative_ranges_are_no_returns(tmp_path: Path) -> None:
    table = FULL.copy()
    table[2, 6], table[3, 6] = 0.0, -1.12892
    assert dict(read_scan(write(tmp_path / "a", HEADER, table)).rejected) == {"no-echo sentinel": 2}


def test_radius_limits(tmp_path: Path) -> None:
    path = write(tmp_path / "a", ["x_m", "y_m", "z_m"], np.vstack([POINTS, [1e4, 0, 0]]))
    scan = read_scan(path, options=LidarOptions(radius_limits_m=(1.0, 2000.0)))
    assert dict(scan.rejected) == {"outside the radius limits": 1}
    with pytest.raises(FormatError, match="check the unit"):
        read_scan(path, options=LidarOptions(radius_limits_m=(1e5, 1e6)))


def test_truncated_and_empty_tables(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", HEADER, FULL)
    path.write_text(path.read_text()[:-60])
    with pytest.raises(FormatError, match=r"a\.csv, line 13: is truncated"):
        read_scan(path)
    path.write_text(",".join(HEADER) + "\n")
    with pytest.raises(FormatError, match="no rows"):
        read_scan(path, format="table")
