"""OLA level 2 tables, built byte by byte from the published layout."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from lidar.formats import open_lidar, recognise
from lidar.formats.missions import OLA_RECORD, write_ola
from lidar.formats.reader import read_scan
from lidar.formats.records import LidarOptions
from lidar.scans import Scan
from spcola.errors import FormatError

# 1-based start, type; what stands in the layout of FORMATS.md, written down a second time here.
FIELDS = {
    "met": (1, "18s"),
    "met_offset": (19, "d"),
    "utc": (27, "24s"),
    "et": (51, "d"),
    "scan_ola_time": (59, "d"),
    "power_cycle": (67, "h"),
    "laser_selection": (69, "h"),
    "scan_mode": (71, "h"),
    "flag_status": (73, "h"),
    "range": (75, "d"),
    "azimuth": (83, "d"),
    "elevation": (91, "d"),
    "intensity_t0": (99, "d"),
    "intensity_trr": (107, "d"),
    "x": (115, "d"),
    "y": (123, "d"),
    "z": (131, "d"),
    "elongitude": (139, "d"),
    "latitude": (147, "d"),
    "radius": (155, "d"),
    "scx": (163, "d"),
    "scy": (171, "d"),
    "scz": (179, "d"),
}
USED = ("et", "flag_status", "range", "x", "y", "z", "elongitude", "latitude", "radius")
USED += ("scx", "scy", "scz")


def shot(index: int, **changed: object) -> dict[str, object]:
    longitude, latitude, radius = 0.3 + 1e-3 * index, -0.2 + 2e-3 * index, 247.0 + 0.1 * index
    x = radius * np.cos(latitude) * np.cos(longitude)
    y = radius * np.cos(latitude) * np.sin(longitude)
    z = radius * np.sin(latitude)
    spacecraft = np.array([700.0, 250.0, -130.0 + 0.02 * index])
    distance = float(np.linalg.norm(np.array([x, y, z]) - spacecraft))
    fields: dict[str, object] = {
        "met": b"3/0603000000.00000",
        "met_offset": 12.5,
        "utc": b"2019-02-08T12:34:56.789 ",
        "et": 602900000.0 + 1e-4 * index,
        "scan_ola_time": 5.0,
        "power_cycle": 7,
        "laser_selection": 1,
        "scan_mode": 0,
        "flag_status": 100 if index % 2 else 0,
        "range": 1e3 * (distance - 1.15),
        "azimuth": 1.0,
        "elevation": -2.0,
        "intensity_t0": 900.0,
        "intensity_trr": 400.0 + index,
        "x": x,
        "y": y,
        "z": z,
        "elongitude": np.degrees(longitude),
        "latitude": np.degrees(latitude),
        "radius": 1e-3 * radius,
        "scx": spacecraft[0],
        "scy": spacecraft[1],
        "scz": spacecraft[2],
    }
    return {**fields, **changed}


def record(fields: dict[str, object], order: str = "<") -> bytes:
    content = bytearray(186)
    for name, (start, code) in FIELDS.items():
        struct.pack_into(order + code, content, start - 1, fields[name])
    return bytes(content)


def table(path: Path, shots: list[dict[str, object]], order: str = "<") -> Path:
    path.write_bytes(b"".join(record(fields, order) for fields in shots))
    return path


def test_the_record_is_the_published_one() -> None:
    assert OLA_RECORD.itemsize == 186
    first = {name: offset + 1 for name, (_, offset, *_) in OLA_RECORD.fields.items()}
    names = {"range": "range_mm", "azimuth": "azimuth_mrad", "elevation": "elevation_mrad"}
    names |= {"elongitude": "elongitude_deg", "latitude": "latitude_deg", "radius": "radius_km"}
    names |= {"x": "xyz", "scx": "scxyz"}
    for name, (start, _) in FIELDS.items():
        if name not in ("y", "z", "scy", "scz"):
            assert first[names.get(name, name)] == start


def test_returns_come_in_metres_and_seconds(tmp_path: Path) -> None:
    shots = [shot(i) for i in range(20)]
    path = table(tmp_path / "scan.bin", shots)
    assert recognise(path) == "ola"
    scan = read_scan(path, options=LidarOptions(sigma_m=0.03, trajectory="ref", body="bennu"))
    assert (scan.name, scan.trajectory, scan.body, len(scan)) == ("scan", "ref", "bennu", 20)
    np.testing.assert_array_equal(scan.points, [[s["x"], s["y"], s["z"]] for s in shots])
    np.testing.assert_array_equal(scan.spacecraft, [[s["scx"], s["scy"], s["scz"]] for s in shots])
    np.testing.assert_array_equal(scan.time, [s["et"] for s in shots])
    np.testing.assert_allclose(scan.reference_offset, 1.15, atol=1e-9)
    np.testing.assert_array_equal(scan.intensity, [s["intensity_trr"] for s in shots])
    np.testing.assert_array_equal(scan.flag, [0, 100] * 10)
    np.testing.assert_array_equal(scan.sigma, 0.03)
    along = scan.spacecraft + (scan.range + 1.15)[:, None] * scan.beam
    np.testing.assert_allclose(along, scan.points, atol=1e-9)


@pytest.mark.parametrize("demodulator", [0, 100])
def test_flags_are_honoured_and_counted(tmp_path: Path, demodulator: int) -> None:
    flags = [0, 1, 1, 2, 3, 7, 0]
    shots = [shot(i, flag_status=flag + demodulator) for i, flag in enumerate(flags)]
    scan = read_scan(table(tmp_path / "a", shots))
    assert len(scan) == 2
    assert dict(scan.rejected) == {"overflow": 2, "no return": 1, "missing": 1, "unknown flag": 1}


@pytest.mark.parametrize("bad_range", [-1128.92, 0.0, -5e5])
def test_the_no_echo_sentinel_never_becomes_a_point(tmp_path: Path, bad_range: float) -> None:
    shots = [shot(i) for i in range(5)]
    near = {name: float(shots[2]["sc" + name]) + 0.01 for name in "xyz"}
    shots[2] = shot(2, range=bad_range, **near)
    scan = read_scan(table(tmp_path / "a", shots))
    assert len(scan) == 4
    assert dict(scan.rejected) == {"no-echo sentinel": 1}


@pytest.mark.parametrize(
    "garbage", [b"\xff" * 8, b"\x00" * 8, b"\x5a" * 8, b"\x01\0\0\0\0\0\xf0\x7f", b"\xee" * 8]
)
def test_garbled_fields_are_counted_and_harm_no_other(tmp_path: Path, garbage: bytes) -> None:
    for name in USED:
        check_one_garbled_field(tmp_path, name, garbage)


def check_one_garbled_field(tmp_path: Path, name: str, garbage: bytes) -> None:
    good = [shot(i) for i in range(9)]
    path = table(tmp_path / "a", good)
    content = bytearray(path.read_bytes())
    start, code = FIELDS[name]
    size = struct.calcsize(code)
    content[4 * 186 + start - 1 : 4 * 186 + start - 1 + size] = garbage[:size]
    path.write_bytes(content)
    scan = read_scan(path)
    expected = 9 if (name, garbage[0]) == ("flag_status", 0) else 8
    # Flag 1 is an overflow; the fourth garbage is a signalling NaN, which numpy warns of.
    # An ephemeris time of zero is a time: of 1 January 2000, as good as any.
    expected = 9 if (name, garbage[0]) == ("et", 0) else expected
    assert len(scan) == expected, name
    assert sum(scan.rejected.values()) == 9 - expected, name
    others = np.delete(np.arange(9), 4)
    kept = scan.points if expected == 8 else scan.points[others]
    np.testing.assert_array_equal(kept, [[good[i][a] for a in "xyz"] for i in others])


@pytest.mark.parametrize("name", sorted(set(FIELDS) - set(USED) - {"intensity_trr"}))
def test_garbled_fields_that_are_not_used_change_nothing(tmp_path: Path, name: str) -> None:
    path = table(tmp_path / "a", [shot(i) for i in range(3)])
    before = read_scan(path)
    content = bytearray(path.read_bytes())
    start, code = FIELDS[name]
    size = struct.calcsize(code)
    content[186 + start - 1 : 186 + start - 1 + size] = b"\xff" * size
    path.write_bytes(content)
    after = read_scan(path)
    np.testing.assert_array_equal(after.points, before.points)
    assert not after.rejected


def test_chunks_join_to_the_whole(tmp_path: Path) -> None:
    shots = [shot(i, flag_status=2 if i % 5 == 0 else 0) for i in range(23)]
    path = table(tmp_path / "a", shots)
    whole = read_scan(path)
    chunks = list(open_lidar(path, options=LidarOptions(chunk=4)))
    assert len(chunks) == 6
    assert max(map(len, chunks)) <= 4
    joined = read_scan(path, options=LidarOptions(chunk=4))
    np.testing.assert_array_equal(joined.points, whole.points)
    assert joined.rejected == whole.rejected == {"no return": 5}


@pytest.mark.parametrize("cut", [1, 100, 185])
def test_a_truncated_table_says_in_which_record(tmp_path: Path, cut: int) -> None:
    path = table(tmp_path / "scan.bin", [shot(i) for i in range(24 * 3)])
    path.write_bytes(path.read_bytes()[:-cut])
    message = rf"scan\.bin: is truncated: record 72 of 72 has {186 - cut} of 186"
    with pytest.raises(FormatError, match=message):
        read_scan(path)


def test_a_byte_swapped_table_is_named_as_such(tmp_path: Path) -> None:
    path = table(tmp_path / "a", [shot(i) for i in range(5)], order=">")
    assert recognise(path) == "ola"
    with pytest.raises(FormatError, match="big-endian"):
        read_scan(path)


def test_old_short_records_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(record(shot(0))[:144] * 31)
    assert recognise(path) == "ola"
    with pytest.raises(FormatError, match="144-byte records"):
        read_scan(path)


@pytest.mark.parametrize(("names", "factor"), [("xyz", 1e-3), ("xyz", 1e3), (("radius",), 1e3)])
def test_a_wrong_unit_refuses_the_table(
    tmp_path: Path, names: tuple[str, ...], factor: float
) -> None:
    shots = [shot(i) for i in range(6)]
    for fields in shots:
        fields.update({name: float(fields[name]) * factor for name in names})
    with pytest.raises(FormatError, match=r"6 of the first 6 returns contradict.*units"):
        read_scan(table(tmp_path / "a", shots))


def test_range_and_point_may_differ_by_what_is_stated(tmp_path: Path) -> None:
    shots = [shot(i) for i in range(6)]
    shots[3]["range"] = float(shots[3]["range"]) + 3000.0
    path = table(tmp_path / "a", shots)
    assert dict(read_scan(path).rejected) == {"range and point disagree": 1}
    assert not read_scan(path, options=LidarOptions(range_tolerance_m=3.1)).rejected
    tight = read_scan(path, options=LidarOptions(reference_offset_m=1.15, range_tolerance_m=1e-6))
    assert len(tight) == 5


def test_writing_and_reading_keep_every_number(tmp_path: Path) -> None:
    scan = read_scan(table(tmp_path / "a", [shot(i) for i in range(50)]))
    write_ola(tmp_path / "b", [scan.select(slice(0, 20)), scan.select(slice(20, None))])
    back = read_scan(tmp_path / "b")
    for name in ("time", "points", "spacecraft", "intensity", "flag", "beam"):
        np.testing.assert_array_equal(getattr(back, name), getattr(scan, name))
    np.testing.assert_allclose(back.range, scan.range, rtol=1e-15)
    written = np.fromfile(tmp_path / "b", dtype=OLA_RECORD)
    assert written["utc"][0] == b"2019-02-08T12:12:10.815"
    assert np.isnan(written["azimuth_mrad"]).all()


def test_what_is_not_known_is_written_as_such(tmp_path: Path) -> None:
    write_ola(tmp_path / "b", [Scan.of_points("a", np.ones((3, 3)))])
    written = np.fromfile(tmp_path / "b", dtype=OLA_RECORD)
    assert np.isnan(written["et"]).all()
    assert np.isnan(written["scxyz"]).all()
    assert set(written["utc"].tolist()) == {b" " * 24}


def test_garbage_and_empty_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"")
    with pytest.raises(FormatError, match="is empty"):
        read_scan(path)
    with pytest.raises(FormatError, match="is empty"):
        read_scan(path, format="ola")
    path.write_bytes(bytes(np.random.default_rng(1).integers(0, 256, 186 * 40, dtype=np.uint8)))
    with pytest.raises(FormatError, match=r"no known lidar format; name .*native, .*ola"):
        read_scan(path)
    with pytest.raises(FormatError, match="is no OLA table"):
        read_scan(path, format="ola")
