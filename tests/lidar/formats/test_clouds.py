"""PLY, PCD and LAS point clouds."""

from __future__ import annotations

import struct
from pathlib import Path

import laspy
import numpy as np
import pytest

from lidar.formats import open_lidar, recognise
from lidar.formats.reader import read_scan
from lidar.formats.records import LidarOptions
from spcola.errors import FormatError

POINTS = np.random.default_rng(5).normal(size=(20, 3)) * 250
INTENSITY = np.arange(20.0)


def ply(path: Path, encoding: str, *, faces: int = 0, before: bool = False) -> Path:
    lines = ["ply", f"format {encoding} 1.0", "comment made in a test"]
    if before:
        lines += ["element camera 2", "property float focus"]
    lines += ["element vertex 20", "property uchar label", "property double x"]
    lines += ["property double y", "property double z", "property float intensity"]
    if faces:
        lines += [f"element face {faces}", "property list uchar int vertex_indices"]
    content = ("\n".join([*lines, "end_header"]) + "\n").encode()
    order = ">" if "big" in encoding else "<"
    if encoding == "ascii":
        content += b"1.5\n2.5\n" * before
        for point, intensity in zip(POINTS, INTENSITY, strict=True):
            values = " ".join(repr(float(value)) for value in point)
            content += f"7 {values} {intensity}\n".encode()
        content += b"3 0 1 2\n" * faces
    else:
        content += struct.pack(order + "ff", 1.5, 2.5) * before
        for point, intensity in zip(POINTS, INTENSITY, strict=True):
            content += struct.pack(order + "Bdddf", 7, *point, intensity)
        content += struct.pack(order + "Biii", 3, 0, 1, 2) * faces
    path.write_bytes(content)
    return path


def pcd(path: Path, data: str) -> Path:
    header = "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z _ intensity\nSIZE 8 8 8 1 4\n"
    header += "TYPE F F F U F\nCOUNT 1 1 1 3 1\nWIDTH 20\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n"
    content = f"{header}POINTS 20\nDATA {data}\n".encode()
    for point, intensity in zip(POINTS, INTENSITY, strict=True):
        if data == "ascii":
            values = " ".join(repr(float(value)) for value in point)
            content += f"{values} 0 0 0 {intensity}\n".encode()
        else:
            content += struct.pack("<dddBBBf", *point, 0, 0, 0, intensity)
    path.write_bytes(content)
    return path


ENCODINGS = ("ascii", "binary_little_endian", "binary_big_endian")
CLOUDS = [*ENCODINGS, "pcd ascii", "pcd binary"]
every_cloud = pytest.mark.parametrize("kind", CLOUDS)


def cloud(path: Path, kind: str) -> Path:
    return pcd(path, kind.split()[1]) if kind.startswith("pcd") else ply(path, kind)


@every_cloud
def test_points_and_intensity(tmp_path: Path, kind: str) -> None:
    path = cloud(tmp_path / "a.dat", kind)
    assert recognise(path) == "cloud"
    scan = read_scan(path, options=LidarOptions(chunk=7))
    np.testing.assert_array_equal(scan.points, POINTS)
    np.testing.assert_array_equal(scan.intensity, INTENSITY)
    for unknown in (scan.time, scan.range, scan.spacecraft, scan.beam, scan.sigma):
        assert np.isnan(unknown).all()
    assert [len(c) for c in open_lidar(path, options=LidarOptions(chunk=7))] == [7, 7, 6]
    km = read_scan(path, options=LidarOptions(unit="km"))
    np.testing.assert_array_equal(km.points, POINTS * 1e3)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_other_elements_are_passed_over(tmp_path: Path, encoding: str) -> None:
    scan = read_scan(ply(tmp_path / "a", encoding, faces=4, before=True))
    np.testing.assert_array_equal(scan.points, POINTS)


@every_cloud
def test_truncated_clouds(tmp_path: Path, kind: str) -> None:
    path = cloud(tmp_path / "a.dat", kind)
    content = path.read_bytes()
    path.write_bytes(content[:-20])
    with pytest.raises(FormatError, match=r"a\.dat.*(is truncated|cut off)"):
        read_scan(path)
    path.write_bytes(content[:40])
    with pytest.raises(FormatError, match=r"a\.dat"):
        read_scan(path, format="cloud")


@every_cloud
def test_every_header_line_lost_or_garbled_once(tmp_path: Path, kind: str) -> None:
    path = cloud(tmp_path / "a.dat", kind)
    content = path.read_bytes()
    mark = b"end_header\n" if content.startswith(b"ply") else b"\nDATA "
    end = content.index(b"\n", content.index(mark) + 6) + 1 if mark[:1] == b"\n" else 0
    end = end or content.index(mark) + len(mark)
    lines = content[:end].splitlines(keepends=True)
    # Comments, and data that do not concern the places of points, may be lost.
    harmless = (b"comment", b"#", b"VIEWPOINT", b"VERSION", b"COUNT")
    for index, line in enumerate(lines):
        for edited in (b"", b"\xff\xfe" + line[2:]):
            damaged = b"".join([*lines[:index], edited, *lines[index + 1 :]]) + content[end:]
            path.write_bytes(damaged)
            if line.startswith(harmless) or b"label" in line:
                continue
            if b"intensity" in line and line.startswith(b"property") and kind == "ascii":
                continue
            if b"property" in line and kind.startswith("binary"):
                continue
            with pytest.raises(FormatError, match=r"a\.dat"):
                read_scan(path, format="cloud")


@pytest.mark.parametrize("kind", ["binary_little_endian", "binary_big_endian", "pcd binary"])
def test_points_that_are_not_numbers_are_counted(tmp_path: Path, kind: str) -> None:
    path = cloud(tmp_path / "a", kind)
    order = ">" if "big" in kind else "<"
    good = struct.pack(order + "d", POINTS[3, 1])
    for value, reason in ((np.nan, "not finite"), (np.inf, "not finite"), (1e200, "not")):
        path.write_bytes(
            cloud(path, kind).read_bytes().replace(good, struct.pack(order + "d", value))
        )
        scan = read_scan(path)
        assert len(scan) == 19
        assert next(iter(scan.rejected)).startswith(reason)


def test_rows_of_text_clouds_garbled_once_are_counted(tmp_path: Path) -> None:
    for kind in ("ascii", "pcd ascii"):
        path = cloud(tmp_path / "a", kind)
        path.write_bytes(path.read_bytes().replace(repr(float(POINTS[3, 1])).encode(), b"*"))
        assert dict(read_scan(path).rejected) == {"unreadable record": 1}


def compressed(path: Path) -> Path:
    content = pcd(path, "binary").read_bytes()
    header, data = content.split(b"DATA binary\n")
    kind = np.dtype([(name, "<f8") for name in "xyz"] + [("_", "u1", 3), ("intensity", "<f4")])
    table = np.frombuffer(data, kind)
    fields = [np.frombuffer(table[name].tobytes(), np.uint8) for name in "xyz"]
    # The padding repeats (3 times 20 zeros); it comes before the intensity but field by field.
    plain = b"".join(f.tobytes() for f in fields)
    packed = b"".join(bytes([len(p) - 1]) + p for p in pieces(plain, 32))
    # One zero, then 59 more copied from one byte back: length 57 = 7 + 50, and 2.
    packed += bytes([0, 0, 7 << 5, 50, 0])
    tail = table["intensity"].tobytes()
    packed += b"".join(bytes([len(p) - 1]) + p for p in pieces(tail, 32))
    size = len(plain) + 60 + len(tail)
    path.write_bytes(
        header + b"DATA binary_compressed\n" + struct.pack("<II", len(packed), size) + packed
    )
    return path


def pieces(content: bytes, size: int) -> list[bytes]:
    return [content[i : i + size] for i in range(0, len(content), size)]


def test_compressed_pcd(tmp_path: Path) -> None:
    path = compressed(tmp_path / "a.pcd")
    scan = read_scan(path, options=LidarOptions(chunk=7))
    np.testing.assert_array_equal(scan.points, POINTS)
    np.testing.assert_array_equal(scan.intensity, INTENSITY)
    content = path.read_bytes()
    begin = content.index(b"compressed\n") + len(b"compressed\n")
    for cut in (begin, begin + 5, len(content) - 1):
        path.write_bytes(content[:cut])
        with pytest.raises(FormatError, match=r"a\.pcd: has compressed points cut off"):
            read_scan(path)
    for index in (begin, begin + 4, begin + 8, begin + 8 + 33):
        damaged = bytearray(content)
        damaged[index] ^= 0xE1
        path.write_bytes(damaged)
        with pytest.raises(FormatError, match=r"a\.pcd: has compressed points cut off"):
            read_scan(path)


def las(path: Path, **changed: object) -> Path:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 1e-3), np.zeros(3)
    file = laspy.LasData(header)
    file.x, file.y, file.z = POINTS.T
    file.intensity = INTENSITY.astype(np.uint16)
    file.gps_time = 1e8 + np.arange(20.0)
    file.classification = np.full(20, 2, dtype=np.uint8)
    for name, value in changed.items():
        setattr(file, name, value)
    file.header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
    file.write(path)
    return path


@pytest.mark.parametrize("suffix", ["las", "laz"])
def test_las_returns(tmp_path: Path, suffix: str) -> None:
    path = las(tmp_path / f"a.{suffix}")
    assert recognise(path) == "las"
    scan = read_scan(path, options=LidarOptions(chunk=7))
    np.testing.assert_allclose(scan.points, POINTS, atol=0.501e-3)
    np.testing.assert_array_equal(scan.intensity, INTENSITY)
    np.testing.assert_array_equal(scan.flag, 2)
    assert np.isnan(scan.time).all()
    assert np.isnan(scan.spacecraft).all()
    timed = read_scan(path, options=LidarOptions(gps_time=True))
    # From 1980-01-06T00:00:00, GPS time; TDB is 51.184 s ahead of it.
    expected = 1.1e9 - 7300.5 * 86400 + 51.184
    np.testing.assert_allclose(timed.time, expected + np.arange(20), atol=1e-6)


def test_copc_returns_of_all_levels_are_read() -> None:
    """A file of copclib 2.6: three nodes of an octree, chunks of unequal length.

    The points are those of the seed, rounded to the file's quantum of 1 mm.
    """
    path = Path(__file__).parent / "data" / "random.copc.laz"
    points = np.random.default_rng(1).uniform(-100, 100, (500, 3)).round(3)
    assert recognise(path) == "las"
    scan = read_scan(path)
    order = [np.lexsort(cloud.T) for cloud in (points, scan.points)]
    np.testing.assert_allclose(scan.points[order[1]], points[order[0]], atol=1e-9)
    assert not scan.rejected


def test_las_noise_and_withheld_are_counted(tmp_path: Path) -> None:
    classes = np.full(20, 2, dtype=np.uint8)
    classes[3], classes[4], classes[5] = 7, 18, 7
    withheld = np.zeros(20, dtype=np.uint8)
    withheld[5] = withheld[6] = 1
    path = las(tmp_path / "a.las", classification=classes, withheld=withheld)
    scan = read_scan(path)
    assert len(scan) == 16
    assert dict(scan.rejected) == {"withheld": 2, "noise class": 2}


def test_a_garbled_las_coordinate_is_counted(tmp_path: Path) -> None:
    path = las(tmp_path / "a.las")
    content = bytearray(path.read_bytes())
    (begin,) = struct.unpack_from("<I", content, 96)
    size = struct.unpack_from("<H", content, 105)[0]
    struct.pack_into("<i", content, begin + 4 * size, 2_000_000_000)
    path.write_bytes(content)
    scan = read_scan(path)
    assert len(scan) == 19
    assert dict(scan.rejected) == {"outside the header's bounds": 1}


@pytest.mark.parametrize("suffix", ["las", "laz"])
def test_truncated_las(tmp_path: Path, suffix: str) -> None:
    path = las(tmp_path / f"a.{suffix}")
    content = path.read_bytes()
    for length in (10, 200, len(content) - 40):
        path.write_bytes(content[:length])
        with pytest.raises(FormatError, match=rf"a\.{suffix}"):
            read_scan(path)


@pytest.mark.parametrize("suffix", ["las", "laz"])
def test_every_header_field_of_las_garbled_once(tmp_path: Path, suffix: str) -> None:
    path = las(tmp_path / f"a.{suffix}")
    content = path.read_bytes()
    before = read_scan(path).points
    # Version, header size, data offset, format, record length, count, scales, offsets, bounds.
    fields = [(24, 2), (94, 2), (96, 4), (104, 1), (105, 2), (131, 8), (179, 8), (247, 8)]
    for start, size in [*fields, *((start, 8) for start in range(131, 227, 8))]:
        damaged = bytearray(content)
        damaged[start : start + size] = b"\xff" * size
        path.write_bytes(damaged)
        try:
            scan = read_scan(path)
        except FormatError as error:
            assert f"a.{suffix}" in str(error)  # noqa: PT017 (either outcome is right)
        else:
            np.testing.assert_array_equal(scan.points, before)


@pytest.mark.real_data
def test_real_las_and_laz(shared_data: Path) -> None:
    folder = shared_data / "pointcloud"
    plain, packed = read_scan(folder / "simple.las"), read_scan(folder / "simple.laz")
    assert len(plain) == 1065
    for name in ("points", "intensity", "flag"):
        np.testing.assert_array_equal(getattr(plain, name), getattr(packed, name))
    chunks = list(open_lidar(folder / "autzen_trim.laz", options=LidarOptions(chunk=30_000)))
    assert [len(chunk) for chunk in chunks] == [30_000, 30_000, 30_000, 20_000]
    assert not any(chunk.rejected for chunk in chunks)
    with pytest.raises(FormatError, match="GPS week"):
        read_scan(folder / "simple.las", options=LidarOptions(gps_time=True))


def test_points_that_crash_the_decompressor_are_one_line() -> None:
    """A file of the fuzzing bench: the native decompressor ends its process by signal 11."""
    path = Path(__file__).parent / "data" / "points_that_crash.laz"
    with pytest.raises(FormatError, match="bring the decompressor down"):
        read_scan(path)
