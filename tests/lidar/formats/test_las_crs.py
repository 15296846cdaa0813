"""Feet and degrees in LAS files are no metres."""

from __future__ import annotations

import struct
from pathlib import Path

import laspy
import numpy as np
import pytest
from rasterio.crs import CRS

from lidar.formats.clouds import read_las_system
from lidar.formats.reader import read_scan
from lidar.formats.records import LidarOptions
from spcola.arrays import FloatArray
from spcola.errors import FormatError

NUMBERS = np.array([[100.0, 200.0, 30.0], [101.0, 198.0, 31.0], [102.5, 197.0, 29.5]])
FOOT, SURVEY_FOOT = 0.3048, 1200.0 / 3937.0


def written(path: Path, *, wkt: str = "", keys: dict[int, int] | None = None) -> Path:
    """A LAS file of NUMBERS whose header states a system as text or as GeoTIFF keys."""
    header = laspy.LasHeader(point_format=6 if wkt else 1, version="1.4" if wkt else "1.2")
    header.scales, header.offsets = np.full(3, 1e-3), np.zeros(3)
    if wkt:
        header.global_encoding.wkt = True
        data = wkt.encode() + b"\0"
        header.vlrs.append(laspy.VLR("LASF_Projection", 2112, "", data))
    if keys:
        words = [1, 1, 0, len(keys)]
        for key, value in keys.items():
            words += [key, 0, 1, value]
        data = struct.pack(f"<{len(words)}H", *words)
        header.vlrs.append(laspy.VLR("LASF_Projection", 34735, "", data))
    las = laspy.LasData(header)
    las.x, las.y, las.z = NUMBERS.T
    las.write(path)
    return path


def text(code: str) -> str:
    return CRS.from_user_input(code).to_wkt()


@pytest.mark.parametrize(
    ("stated", "units"),
    [
        ({}, (1.0, 1.0)),
        ({"wkt": text("EPSG:26917")}, (1.0, 1.0)),
        ({"wkt": text("EPSG:2994")}, (FOOT, FOOT)),
        ({"wkt": text("EPSG:4978")}, (1.0, 1.0)),
        ({"wkt": text("EPSG:2285+6360")}, (SURVEY_FOOT, SURVEY_FOOT)),
        ({"wkt": text("EPSG:26910+6360")}, (1.0, SURVEY_FOOT)),
        ({"wkt": text("EPSG:2994+5703")}, (FOOT, 1.0)),
        ({"keys": {1024: 1, 3072: 2994}}, (FOOT, FOOT)),
        ({"keys": {1024: 1, 3072: 32767, 3076: 9003}}, (SURVEY_FOOT, SURVEY_FOOT)),
        ({"keys": {1024: 1, 3072: 26910, 4099: 9002}}, (1.0, FOOT)),
        ({"keys": {1024: 1, 3072: 26910, 4096: 6360}}, (1.0, SURVEY_FOOT)),
        ({"keys": {1024: 3, 3076: 9001}}, (1.0, 1.0)),
    ],
)
def test_lengths_of_any_unit_become_metres(
    tmp_path: Path, stated: dict[str, object], units: tuple[float, float]
) -> None:
    path = written(tmp_path / "a.las", **stated)  # type: ignore[arg-type]
    expected: FloatArray = NUMBERS * [units[0], units[0], units[1]]
    np.testing.assert_allclose(read_scan(path).points, expected, rtol=1e-9)
    if stated and units != (1.0, 1.0):
        with pytest.raises(FormatError, match="not in m; leave the unit out"):
            read_scan(path, options=LidarOptions(unit="m"))
    assert (read_las_system(path).kind == "not stated") == (not stated)


def test_a_unit_that_the_file_states_too_may_be_given(tmp_path: Path) -> None:
    path = written(tmp_path / "a.las", wkt=text("EPSG:26917"))
    np.testing.assert_allclose(read_scan(path, options=LidarOptions(unit="m")).points, NUMBERS)
    plain = written(tmp_path / "b.las")
    far = read_scan(plain, options=LidarOptions(unit="km")).points
    np.testing.assert_allclose(far, 1e3 * NUMBERS)


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ({"wkt": text("EPSG:4326")}, "longitude and latitude"),
        ({"wkt": text("EPSG:5498")}, "longitude and latitude"),
        ({"keys": {1024: 2, 2048: 4326}}, "longitude and latitude"),
        ({"keys": {1024: 2, 2048: 32767}}, "longitude and latitude"),
        ({"keys": {1024: 1, 3072: 32767}}, "cannot be read"),
        ({"keys": {1024: 77}}, "cannot be read"),
        ({"keys": {1024: 1, 3072: 1100}}, "cannot be read"),
        ({"wkt": 'PROJCS["cut off'}, "cannot be read"),
    ],
)
def test_what_is_no_length_is_refused_in_one_line(
    tmp_path: Path, stated: dict[str, object], message: str
) -> None:
    path = written(tmp_path / "a.las", **stated)  # type: ignore[arg-type]
    with pytest.raises(FormatError, match=message) as caught:
        read_scan(path)
    assert "a.las" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.real_data
def test_feet_of_oregon_are_not_metres(shared_data: Path) -> None:
    system = read_las_system(shared_data / "pointcloud" / "autzen_trim.laz")
    assert (system.kind, system.unit_m, system.height_unit_m) == ("projected", FOOT, FOOT)
    assert read_las_system(shared_data / "pointcloud" / "simple.las").kind == "not stated"
