"""Scans in files: what was written comes back, in the size that was foretold."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import pytest

from lidar.formats import open_lidar, read_scan, recognise
from lidar.formats.native import scan_summary
from lidar.formats.records import LidarOptions
from lidar.scans import Scan, join
from lidar.truth import (
    SCAN_FORMATS,
    LidarSettings,
    ScanErrors,
    TrackSettings,
    scan_chunks,
    scan_size,
    write_scans,
)
from lidar.truth.files import returns_of
from spcola.errors import InvalidValueError, SettingsError
from spcola.truth.body import BodySettings, TruthBody, stream
from spcola.truth.campaign import Pass

AT = Pass(1, 615_211_269.184, 300.0, 15465.6, 0.7, 0.4, 1000.0)
SETTINGS = LidarSettings(width=30.0, spacing=0.2)
NAMES = {"ola": "ola", "hdf5": "native", "laz": "las"}


@pytest.fixture(scope="module")
def body() -> TruthBody:
    return TruthBody(BodySettings(seed=7, radius=40.0))


@pytest.fixture(scope="module")
def scan(body: TruthBody) -> Scan:
    chunks = scan_chunks(
        body, AT, settings=SETTINGS, errors=ScanErrors(), generator=stream(1, "shots")
    )
    return join("scan01", list(chunks))


def pieces(scan: Scan, size: int) -> list[Scan]:
    return [scan.select(slice(k, k + size)) for k in range(0, len(scan), size)]


def in_time(scan: Scan) -> Scan:
    """The returns in the order in which they were taken: native scans are sorted by place."""
    return scan.select(np.argsort(scan.time, kind="stable"))


@pytest.mark.parametrize("format", SCAN_FORMATS)
def test_returns_come_back_and_rejects_do_not(scan: Scan, tmp_path: Path, format: str) -> None:
    path = tmp_path / f"scan01{SCAN_FORMATS[format]}"
    write_scans(path, pieces(scan, 7000), format=format)
    assert recognise(path) == NAMES[format]
    back = in_time(read_scan(path))
    kept = scan.flag % 100 == 0
    good = scan.select(kept)
    # LAZ and HDF5 count in tenths of millimetres and half of that: half of one is lost.
    lost = {"rtol": 0, "atol": {"laz": 5.1e-5, "hdf5": 2.6e-5, "ola": 1e-12}[format]}
    assert back.name == "scan01"
    np.testing.assert_allclose(back.time, good.time, rtol=0, atol=1e-6)
    np.testing.assert_allclose(back.range, good.range, **lost)
    np.testing.assert_allclose(back.spacecraft, good.spacecraft, **lost)
    np.testing.assert_allclose(back.points, good.points, **lost)
    np.testing.assert_allclose(back.beam, good.beam, rtol=0, atol=2e-7)
    np.testing.assert_array_equal(back.flag, good.flag)
    np.testing.assert_allclose(
        back.intensity, good.intensity, rtol=1e-7, atol=0.5 if format == "laz" else 0
    )
    np.testing.assert_allclose(back.reference_offset, 1.1, rtol=0, atol=3e-4)
    if format != "laz":
        counts = {"no return": 2, "overflow": 1, "missing": 3}
        assert dict(back.rejected) == {
            name: int(np.sum(scan.flag % 100 == value)) for name, value in counts.items()
        }


@pytest.mark.parametrize("format", SCAN_FORMATS)
def test_equal_scans_are_equal_bytes_however_chunked(
    scan: Scan, tmp_path: Path, format: str
) -> None:
    one, many = tmp_path / "one", tmp_path / "many"
    write_scans(one, [scan], format=format)
    write_scans(many, pieces(scan, 4096), format=format)
    first, second = in_time(read_scan(one)), in_time(read_scan(many))
    np.testing.assert_array_equal(first.points, second.points)
    if format != "hdf5":
        assert one.read_bytes() == many.read_bytes()


@pytest.mark.parametrize("format", SCAN_FORMATS)
@pytest.mark.parametrize("spacing", [0.1, 0.4])
def test_the_size_is_known_before(
    body: TruthBody, tmp_path: Path, format: str, spacing: float
) -> None:
    settings = LidarSettings(width=30.0, spacing=spacing)
    expected = scan_size(settings, format)
    errors, path = ScanErrors(), tmp_path / "scan"
    write_scans(
        path,
        scan_chunks(body, AT, settings=settings, errors=errors, generator=stream(1, "size")),
        format=format,
    )
    count = len(read_scan(path))
    assert expected.shots == settings.shots
    # Boulders and slopes cost some more: they are not in the estimate.
    assert count == pytest.approx(expected.returns, rel=0.03)
    assert path.stat().st_size == pytest.approx(expected.bytes, rel=0.15)
    if format == "ola":
        assert path.stat().st_size == expected.bytes


@pytest.mark.parametrize("format", SCAN_FORMATS)
def test_tracks_are_written_too(body: TruthBody, tmp_path: Path, format: str) -> None:
    track = TrackSettings(period=40_000.0, rate=0.5).plan()[0]
    chunks = scan_chunks(
        body, track, settings=SETTINGS, errors=ScanErrors(), generator=stream(2, "track")
    )
    path = tmp_path / "track01"
    write_scans(path, chunks, format=format)
    expected = scan_size(SETTINGS, format, track=track)
    assert expected.shots == 10_800
    assert len(read_scan(path)) == pytest.approx(expected.returns, rel=0.03)
    assert path.stat().st_size == pytest.approx(expected.bytes, rel=0.15)


def test_only_the_chunk_at_hand_is_asked_for(scan: Scan, tmp_path: Path) -> None:
    alive: list[int] = []

    class Watched:
        def __init__(self, inner: Scan) -> None:
            self.inner = inner
            alive.append(1)

        def __del__(self) -> None:
            alive.pop()

    most = []

    def chunks():
        for piece in pieces(scan, 4096):
            watched = Watched(piece)
            most.append(len(alive))
            yield watched.inner

    for format in SCAN_FORMATS:
        write_scans(tmp_path / "scan", chunks(), format=format)
    assert max(most) <= 2


def test_native_files_count_what_they_leave_out(scan: Scan, tmp_path: Path) -> None:
    path = tmp_path / "scan.h5"
    write_scans(path, pieces(scan, 5000), format="hdf5")
    summary = scan_summary(path)
    assert summary.count + sum(summary.rejected.values()) == SETTINGS.shots
    kept = next(returns_of([scan]))
    assert summary.rejected == kept.rejected


def test_a_laz_file_of_points_alone_has_no_range(scan: Scan, tmp_path: Path) -> None:
    cloud = Scan.of_points("cloud", scan.points[scan.flag % 100 == 0])
    write_scans(tmp_path / "cloud.laz", [cloud], format="laz")
    back = read_scan(tmp_path / "cloud.laz")
    np.testing.assert_allclose(back.points, cloud.points, rtol=0, atol=5.1e-5)
    assert np.isnan(back.range).all()
    assert np.isnan(back.time).all()
    assert np.isnan(back.spacecraft).all()


def test_far_returns_are_rounded_more_coarsely(scan: Scan, tmp_path: Path) -> None:
    good = scan.select(scan.flag % 100 == 0)
    shift = np.array([3.0e5, 0.0, 0.0])
    far = replace(good, points=good.points + shift, spacecraft=good.spacecraft + shift)
    write_scans(tmp_path / "far.laz", [far], format="laz")
    back = read_scan(tmp_path / "far.laz")
    np.testing.assert_allclose(back.points, far.points, rtol=0, atol=5.1e-4)


def test_what_a_laz_file_cannot_hold_is_refused(scan: Scan, tmp_path: Path) -> None:
    good = scan.select(scan.flag % 100 == 0)
    unknown = replace(good, spacecraft=np.full_like(good.spacecraft, np.nan))
    far = replace(good, points=good.points * 1e5)
    timeless = replace(good, time=np.full(len(good), np.nan))
    for later in (unknown, far, timeless):
        with pytest.raises(InvalidValueError, match="later chunk"):
            write_scans(tmp_path / "scan.laz", [good, later], format="laz")
    with pytest.raises(InvalidValueError, match="no return"):
        write_scans(tmp_path / "scan.laz", [scan.select(scan.flag % 100 == 2)], format="laz")
    assert list(tmp_path.iterdir()) == []


def test_las_without_compression_reads_back_alike(scan: Scan, tmp_path: Path) -> None:
    from lidar.formats.clouds import write_las  # noqa: PLC0415

    good = scan.select(scan.flag % 100 == 0)
    write_las(tmp_path / "scan.las", [good], compressed=False)
    write_las(tmp_path / "scan.laz", [good])
    plain, packed = read_scan(tmp_path / "scan.las"), read_scan(tmp_path / "scan.laz")
    for layer in ("points", "time", "range", "spacecraft", "intensity", "flag"):
        np.testing.assert_array_equal(getattr(plain, layer), getattr(packed, layer))
    assert (tmp_path / "scan.las").stat().st_size > 5 * (tmp_path / "scan.laz").stat().st_size


def test_other_readers_find_all_that_a_laz_file_holds(scan: Scan, tmp_path: Path) -> None:
    good = scan.select(scan.flag % 100 == 0)
    write_scans(tmp_path / "scan.laz", pieces(scan, 6000), format="laz")
    las = laspy.read(tmp_path / "scan.laz")
    header = las.header
    assert (str(header.version), header.point_format.id) == ("1.4", 6)
    assert header.point_count == len(good)
    np.testing.assert_allclose(header.mins, good.points.min(axis=0), rtol=0, atol=5.1e-5)
    np.testing.assert_allclose(header.maxs, good.points.max(axis=0), rtol=0, atol=5.1e-5)
    assert header.creation_date.isoformat() == "2019-07-01"
    assert list(header.point_format.extra_dimension_names) == [
        "flag", "range", "spacecraft_x", "spacecraft_y", "spacecraft_z",
    ]  # fmt: skip
    extras = header.vlrs.get("ExtraBytesVlr")[0].extra_bytes_structs
    assert not any(extra.min_is_relevant() or extra.max_is_relevant() for extra in extras)
    # 2019 JUL 01 00:00:00 UTC is 1 245 974 418 s of GPS time (18 leap seconds).
    middle = las.gps_time[len(good) // 2] + 1e9
    assert middle == pytest.approx(1_245_974_418 + 150, abs=1.0)
    np.testing.assert_allclose(np.asarray(las["range"]), good.range, rtol=0, atol=5.1e-5)


def test_a_damaged_laz_range_is_refused(scan: Scan, tmp_path: Path) -> None:
    good = scan.select(scan.flag % 100 == 0)
    measured = good.range.copy()
    measured[:10] += 5.0
    write_scans(tmp_path / "scan.laz", [replace(good, range=measured)], format="laz")
    assert dict(read_scan(tmp_path / "scan.laz").rejected) == {"range and point disagree": 10}


def test_formats_are_known_by_name(scan: Scan, tmp_path: Path) -> None:
    for call in (
        lambda: scan_size(SETTINGS, "las"),
        lambda: write_scans(tmp_path / "x", [scan], format="csv"),
    ):
        with pytest.raises(SettingsError, match="ola, hdf5, laz"):
            call()


def test_chunks_of_the_reader_are_of_the_size_asked_for(scan: Scan, tmp_path: Path) -> None:
    write_scans(tmp_path / "scan.laz", [scan], format="laz")
    sizes = [len(c) for c in open_lidar(tmp_path / "scan.laz", options=LidarOptions(chunk=5000))]
    assert max(sizes) == 5000
