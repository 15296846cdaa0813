"""Hayabusa, Hayabusa2, NEAR NLR, LOLA and track tables, built column by column."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from lidar.formats import open_lidar, recognise
from lidar.formats.reader import read_scan
from lidar.formats.records import LidarOptions
from spcola.errors import FormatError
from spcola.navigation import et_from_utc

COUNT = 9


def utc(index: int) -> str:
    return f"2005-09-12T02:53:{15 + index:02d}.125"


def point(index: int, radius: float) -> tuple[float, float, np.ndarray]:
    """Longitude and latitude, degrees, and x, y, z of a return."""
    longitude, latitude = 40.0 + index, -12.0 + 0.5 * index
    lon, lat = np.radians([longitude, latitude])
    unit = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    return longitude, latitude, (radius + index) * unit


def hayabusa(index: int) -> str:
    *_, surface = point(index, 160.0)
    craft = np.array([9e3, 8e3 + index, -2e3])
    numbers = [np.linalg.norm(surface - craft) / 1e3]
    line = f"{3000000 + index:10d} {utc(index)} {numbers[0]:8.5f}"
    line += "".join(f" {value / 1e3:9.5f}" for value in (*craft, *surface))
    rest = " ".join(["1.23456"] * 22)
    return f"{line} {rest}".ljust(289) + "\r\n"


def hayabusa2(index: int) -> str:
    longitude, latitude, surface = point(index, 450.0)
    craft = np.array([1e4, 16e3 + index, -1280.0])
    values = [np.linalg.norm(surface - craft), longitude, latitude, 450.0 + index, *surface, *craft]
    return ",".join([utc(index), *(f"{value:.3f}" for value in values)]) + "\n"


def nlr(index: int, noise: int = 0) -> str:
    longitude, latitude, surface = point(index, 8000.0)
    craft_longitude, craft_latitude, craft_radius = 44.0 + index, -10.0, 50e3
    lon, lat = np.radians([craft_longitude, craft_latitude])
    craft = craft_radius * np.array(
        [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]
    )
    measured = np.linalg.norm(surface - craft)
    fields = [
        *(f"{longitude:.5f}", f"{latitude:.5f}", f"{8000.0 + index:.3f}"),
        *(f"{et_from_utc(utc(index)):.3f}", utc(index), f"{measured:.2f}", "1", f"{noise}"),
        *(f"{craft_longitude:.5f}", f"{craft_latitude:.5f}", f"{craft_radius:.2f}"),
        *("1.25", "0.50", "3043423444"),
        *(f"{value:.2f}" for value in surface),
        *("0.5", "-53000.1"),
    ]
    return " ".join(fields).ljust(191) + "\r\n"


def lola(index: int) -> str:
    longitude, latitude, surface = point(index, 1735e3)
    craft_longitude, craft_latitude, craft_radius = longitude + 0.02, latitude - 0.01, 1790e3
    lon, lat = np.radians([craft_longitude, craft_latitude])
    craft = craft_radius * np.array(
        [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]
    )
    measured = np.linalg.norm(surface - craft) - 0.545
    fields = ["0"] * 29
    fields[0] = utc(index)
    fields[1:4] = [f"{longitude:.7f}", f"{latitude:.7f}", f"{1735 + index / 1e3:.6f}"]
    fields[4] = f"{measured / 1e3:.6f}"
    fields[15] = f"{et_from_utc(utc(index)):.9f}"
    fields[18:21] = [f"{craft_longitude:.7f}", f"{craft_latitude:.7f}", f"{craft_radius / 1e3:.6f}"]
    return ",".join(field.rjust(13) for field in fields) + "\n"


def track(index: int) -> str:
    *_, surface = point(index, 250.0)
    numbers = [*surface / 1e3, 0.7, 0.25 + index / 1e3, -0.13]
    return " ".join([utc(index), *(repr(float(value)) for value in numbers)]) + "\n"


HEADER = "NLR header of one line\nlonE latN Eros_rad and so on\n"
# Builder, header, radius of the first return, whether a point that is wrong contradicts itself.
FORMATS: dict[str, tuple[Callable[[int], str], str, float]] = {
    "hayabusa": (hayabusa, "", 160.0),
    "hayabusa2": (hayabusa2, "", 450.0),
    "nlr": (nlr, HEADER, 8000.0),
    "lola": (lola, "", 1735e3),
    "track": (track, "", 250.0),
}
every_format = pytest.mark.parametrize("name", list(FORMATS))


def write(path: Path, name: str, edit: Callable[[int, str], str] = lambda _, line: line) -> Path:
    build, header, _ = FORMATS[name]
    lines = [edit(index, build(index)) for index in range(COUNT)]
    path.write_bytes((header + "".join(lines)).encode())
    return path


def test_records_are_as_long_as_published() -> None:
    assert len(hayabusa(0)) == 291
    assert len(nlr(0)) == 193


@every_format
def test_recognised_and_read_in_metres(tmp_path: Path, name: str) -> None:
    path = write(tmp_path / "shots.x", name)
    assert recognise(path) == name
    scan = read_scan(path)
    assert (len(scan), dict(scan.rejected), scan.name) == (COUNT, {}, "shots")
    expected = [point(index, FORMATS[name][2])[2] for index in range(COUNT)]
    np.testing.assert_allclose(scan.points, expected, atol=0.01)
    np.testing.assert_allclose(scan.time, [et_from_utc(utc(i)) for i in range(COUNT)], atol=1e-3)
    np.testing.assert_allclose(np.linalg.norm(scan.beam, axis=1), 1, atol=1e-12)
    offset = 0.545 if name == "lola" else 0.0
    # NLR's spacecraft has five decimals of a degree: 4 m across the beam.
    tolerance = {"nlr": 1.0, "hayabusa": 0.02}.get(name, 0.003)
    np.testing.assert_allclose(scan.reference_offset, offset, atol=tolerance)


@every_format
def test_chunks_are_bounded_and_join(tmp_path: Path, name: str) -> None:
    path = write(tmp_path / "a", name)
    chunks = list(open_lidar(path, options=LidarOptions(chunk=4)))
    assert [len(chunk) for chunk in chunks] == [4, 4, 1]
    joined = read_scan(path, options=LidarOptions(chunk=4))
    np.testing.assert_array_equal(joined.points, read_scan(path).points)


@every_format
@pytest.mark.parametrize("damage", ["cut", "text", "bytes", "more"])
def test_one_broken_row_is_counted(tmp_path: Path, name: str, damage: str) -> None:
    def edit(index: int, line: str) -> str:
        if index != 4:
            return line
        end = "\r\n" if line.endswith("\r\n") else "\n"
        return {
            "cut": line[: len(line) // 3],
            "text": line[:60] + "xx" + line[62:].rstrip(),
            "bytes": line[:62] + "\x01\x02" + line[64:].rstrip(),
            "more": line.rstrip() + ", 1.0 1.0",
        }[damage] + end

    scan = read_scan(write(tmp_path / "a", name, edit))
    assert len(scan) == COUNT - 1
    assert sum(scan.rejected.values()) == 1
    expected = [point(i, FORMATS[name][2])[2] for i in range(COUNT) if i != 4]
    np.testing.assert_allclose(scan.points, expected, atol=0.01)


def columns_of(name: str, line: str) -> list[str]:
    return line.split(",") if name in ("hayabusa2", "lola") else line.split()


USED = {
    "hayabusa": range(1, 9),
    "hayabusa2": range(11),
    "nlr": [0, 1, 2, 3, 4, 5, 7, 8, 9, 10, 14, 15, 16],
    "lola": [0, 1, 2, 3, 4, 10, 15, 18, 19, 20],
}


def garbled(name: str, column: int, garbage: str) -> Callable[[int, str], str]:
    """An edit of the third record."""

    def edit(index: int, line: str) -> str:
        if index != 2:
            return line
        old = columns_of(name, line)[column].rstrip()
        # The fields keep their places, as in a record damaged on its way.
        new = garbage.rjust(len(old))
        where = sum(len(field) + 1 for field in line.split(",")[:column]) if "," in line else -1
        if where < 0:
            before = columns_of(name, line)[:column]
            for field in before:
                where = line.index(field, where + 1) + len(field) - 1
            where = line.index(old, where + 1)
        return line[:where] + new + line[where + len(old) :]

    return edit


@pytest.mark.parametrize("name", USED)
def test_each_used_field_garbled_once_is_counted(tmp_path: Path, name: str) -> None:
    passed_over = []
    for column, garbage in product(USED[name], ["nan", "9e9", "?"]):
        scan = read_scan(write(tmp_path / "a", name, garbled(name, column, garbage)))
        if (len(scan), sum(scan.rejected.values())) != (COUNT - 1, 1):
            passed_over.append((column, garbage))
    assert not passed_over


@every_format
def test_a_truncated_last_row_is_named(tmp_path: Path, name: str) -> None:
    path = write(tmp_path / "shots.x", name)
    content = path.read_bytes()
    line = COUNT + FORMATS[name][1].count("\n")
    path.write_bytes(content[: -len(FORMATS[name][0](0)) // 2])
    with pytest.raises(FormatError, match=rf"shots\.x, line {line}: is truncated"):
        read_scan(path)
    whole = content.rstrip()
    path.write_bytes(whole)
    assert len(read_scan(path)) == COUNT


@every_format
def test_a_file_of_another_kind_is_refused_when_named(tmp_path: Path, name: str) -> None:
    path = tmp_path / "a"
    path.write_text("one two\nthree four\nfive\n" * 20)
    with pytest.raises(FormatError):
        read_scan(path, format=name)
    path.write_bytes(b"\0\1\2" * 100)
    with pytest.raises(FormatError):
        read_scan(path, format=name)
    path.write_bytes(b"")
    with pytest.raises(FormatError):
        read_scan(path, format=name)


@pytest.mark.parametrize("name", ["hayabusa2", "nlr", "lola"])
def test_a_range_in_kilometres_refuses_the_table(tmp_path: Path, name: str) -> None:
    column = {"hayabusa2": 1, "nlr": 5, "lola": 4}[name]

    def edit(_: int, line: str) -> str:
        old = columns_of(name, line)[column]
        factor = 1e3 if name == "lola" else 1e-3
        return line.replace(old, f"{float(old) * factor:.6g}".rjust(len(old)), 1)

    with pytest.raises(FormatError, match="9 of the first 9 returns contradict themselves"):
        read_scan(write(tmp_path / "a", name, edit))


def test_noise_of_the_rangefinder_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a"
    flags = [0, 1, 1, 0, 2, 0, 0]
    path.write_text(HEADER + "".join(nlr(i, flag) for i, flag in enumerate(flags)), newline="")
    scan = read_scan(path)
    assert len(scan) == 4
    assert dict(scan.rejected) == {"noise": 2, "unknown flag": 1}


def test_a_header_of_lola_rows_is_passed_over(tmp_path: Path) -> None:
    path = write(tmp_path / "a", "lola")
    names = ["Coordinated_Universal_Time"] + [f"C{i}" for i in range(2, 30)]
    path.write_text(",".join(names) + "\n" + path.read_text())
    assert recognise(path) == "lola"
    assert len(read_scan(path)) == COUNT


@pytest.mark.parametrize("timed", [False, True])
@pytest.mark.parametrize("width", [3, 4, 6, 7])
def test_variants_of_tracks(tmp_path: Path, timed: bool, width: int) -> None:
    numbers = [0.1, 0.2, 0.2, 0.5, 0.4, 0.3, 77.0]
    if width == 4:
        numbers[3] = 77.0
    line = " ".join([utc(0)] * timed + [str(n) for n in numbers[:width]]) + "\n"
    path = tmp_path / "a.txt"
    path.write_text(line * 3)
    scan = read_scan(path, format="track")
    np.testing.assert_allclose(scan.points, [[100.0, 200.0, 200.0]] * 3)
    assert np.isfinite(scan.time).all() == timed
    assert np.isfinite(scan.intensity).all() == (width in (4, 7))
    assert np.isfinite(scan.spacecraft).all() == (width > 4)
    metres = read_scan(path, format="track", options=LidarOptions(unit="m"))
    np.testing.assert_allclose(metres.points, [[0.1, 0.2, 0.2]] * 3)
    if timed:
        assert recognise(path) == "track"
    else:
        with pytest.raises(FormatError, match="no known lidar format"):
            recognise(path)


def test_lola_binary_rows(tmp_path: Path) -> None:
    rows = np.zeros((4, 64), dtype="<u4")
    signed = rows.view("<i4")
    rows[:, 2], rows[:, 3] = 317845253 + np.arange(4), 2**31
    signed[:, 6], signed[:, 7] = 100 * 10**7, 60 * 10**7
    rows[:, 8], rows[:, 9] = 1790000000, 1737000000
    for spot in range(5):
        first = 10 + 10 * spot
        signed[:, first], signed[:, first + 1] = 100 * 10**7, 60 * 10**7 + spot
        signed[:, first + 2], rows[:, first + 3] = 1735000000, 55000000 - 545
    signed[0, 12], rows[0, 13] = -1, 2**32 - 1
    rows[1, 23] = 2**32 - 1
    rows[2, 29] = 1
    path = tmp_path / "a.dat"
    path.write_bytes(rows.tobytes())
    assert recognise(path) == "lola"
    scan = read_scan(path)
    assert len(scan) == 17
    assert dict(scan.rejected) == {"missing": 2, "shot flag": 1}
    np.testing.assert_allclose(scan.reference_offset, 0.545, atol=1e-6)
    np.testing.assert_array_equal(scan.time[:4], 317845253.5)
    path.write_bytes(rows.tobytes()[:-10])
    with pytest.raises(FormatError, match="truncated: record 4 of 4 has 246 of 256 bytes"):
        read_scan(path)


@pytest.mark.real_data
def test_the_public_lola_shots(shared_data: Path) -> None:
    folder = shared_data / "moon_lola"
    scan = read_scan(folder / "lidarPoints.csv")
    assert (len(scan), dict(scan.rejected)) == (105, {})
    offset = scan.reference_offset
    assert offset.mean() == pytest.approx(0.545, abs=1e-4)
    assert offset.std() < 0.7e-3
    # The JSON states the same places; times there are ephemeris times of the shots.
    controls = json.loads((folder / "lidarData.json").read_text())["points"]
    assert len(controls) == 52
    with (folder / "lidarPoints.csv").open() as stream:
        rows = [[float(row[i]) for i in (2, 1, 3, 4)] for row in csv.reader(stream)]
    for control in controls:
        index = int(np.argmin(np.abs(scan.time - control["time"])))
        # The table's ephemeris time is terrestrial time: 0.666 ms, or 1.1 m of orbit, early.
        assert abs(scan.time[index] - control["time"]) < 1e-6
        assert scan.range[index] == pytest.approx(control["range"] * 1e3, abs=1e-6)
        stated = [control[key] for key in ("latitude", "longitude", "radius", "range")]
        np.testing.assert_allclose(rows[index], stated, rtol=0, atol=1e-9)
        lat, lon = np.radians([control["latitude"], control["longitude"]])
        unit = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
        np.testing.assert_allclose(scan.points[index], control["radius"] * 1e3 * unit, atol=1e-6)


@pytest.mark.real_data
def test_the_public_hayabusa2_shots(shared_data: Path) -> None:
    path = shared_data / "ryugu" / "hyb2_ldr_l2_aocsm_topo_ts_20180701_odd_rows.csv"
    assert recognise(path) == "hayabusa2"
    scan = read_scan(path)
    assert (len(scan), dict(scan.rejected)) == (26, {})
    # All numbers are given to a millimetre, the range to a decimetre of which the points are made.
    assert np.abs(scan.reference_offset).max() < 1e-3
    assert scan.points[0].tolist() == [478.268, -134.426, 50.031]
    assert scan.time[0] == pytest.approx(et_from_utc("2018-07-01T22:50:11.217091"))
