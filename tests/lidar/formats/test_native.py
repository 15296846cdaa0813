"""Native scans: what goes in comes out, and broken files are named."""

from __future__ import annotations

from pathlib import Path
from zlib import crc32

import h5py
import numpy as np
import pytest

from lidar.formats import recognise
from lidar.formats.native import iter_scan, scan_summary, write_scan
from lidar.formats.reader import read_scan
from lidar.formats.records import LidarOptions
from lidar.scans import Scan
from lidar.scans.cubes import QUANTUM_M
from lidar.scans.scan import MEASURES
from spcola.errors import FormatError, InvalidValueError, WorkspaceError


def scan_of(count: int, seed: int = 1) -> Scan:
    rng = np.random.default_rng(seed)
    return Scan.of_points(
        "track",
        rng.normal(size=(count, 3)) * 250,
        spacecraft=rng.normal(size=(count, 3)) * 1e4,
        time=6e8 + np.arange(count) * 1e-2,
        intensity=rng.normal(size=count),
        flag=rng.integers(0, 100, count),
        trajectory="spk",
        body="IAU_BENNU",
    )


def chunks_of(scan: Scan, size: int) -> list[Scan]:
    chunks = [scan.select(slice(i, i + size)) for i in range(0, len(scan), size)]
    counted = Scan(
        **{name: getattr(chunks[0], name) for name in ("name", *MEASURES, "trajectory", "body")},
        rejected={"overflow": 3},
    )
    return [counted, *chunks[1:]]


def assert_same(a: Scan, b: Scan) -> None:
    """Equal to the quantum, in any order."""
    a, b = (scan.select(np.argsort(scan.time, kind="stable")) for scan in (a, b))
    lost = {"points": QUANTUM_M, "range": QUANTUM_M, "time": 1e-6, "beam": 1e-7}
    for name in MEASURES:
        np.testing.assert_allclose(
            getattr(a, name),
            getattr(b, name),
            rtol=6e-8 if name in ("intensity", "sigma") else 0,
            # Half a quantum, and the rounding of a double that is as large as an epoch.
            atol=0.502 * lost.get(name, 0) + (1.2e-7 if name == "time" else 0),
        )
    assert (a.name, a.trajectory, a.body) == (b.name, b.trajectory, b.body)


@pytest.mark.parametrize("size", [1, 7, 1000])
def test_round_trip_by_chunks(tmp_path: Path, size: int) -> None:
    scan = scan_of(100)
    path = tmp_path / "a"
    written = write_scan(path, chunks_of(scan, size), digest="sha", parameters={"day": 3})
    assert recognise(path) == "native"
    back = read_scan(path, options=LidarOptions(chunk=9))
    assert_same(back, scan)
    assert dict(back.rejected) == {"overflow": 3}
    block = min(size, 100)
    lengths = [len(c) for c in iter_scan(path, chunk=60)]
    assert lengths == (
        [60, 40] if block == 100 else [block] * (100 // block) + [100 % block] * (100 % block > 0)
    )
    summary = scan_summary(path)
    for got in (summary, written):
        assert (got.name, got.count, got.digest) == ("track", 100, "sha")
        assert (got.trajectory, got.body) == ("spk", "IAU_BENNU")
        assert dict(got.parameters) == {"day": 3}
        assert got.time_span == (scan.time[0], scan.time[-1])
        np.testing.assert_array_equal(got.bounds, [scan.points.min(0), scan.points.max(0)])


def test_unknown_layers_and_empty_scans_survive(tmp_path: Path) -> None:
    points = np.arange(6.0).reshape(2, 3)
    empty = Scan.of_points("a", np.empty((0, 3)))
    write_scan(tmp_path / "a", [empty, Scan.of_points("a", points)])
    back = read_scan(tmp_path / "a")
    np.testing.assert_allclose(back.points, points, rtol=0, atol=QUANTUM_M / 2)
    assert np.isnan(back.time).all()
    assert np.isnan(scan_summary(tmp_path / "a").time_span).all()
    np.testing.assert_array_equal(scan_summary(tmp_path / "a").bounds, points)
    write_scan(tmp_path / "b", [empty])
    assert len(read_scan(tmp_path / "b")) == 0
    assert np.isnan(scan_summary(tmp_path / "b").bounds).all()


def test_a_failed_write_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "a"
    scan = scan_of(10)
    write_scan(path, [scan])
    before = path.read_bytes()
    other = Scan.of_points("track", scan.points, body="elsewhere")
    with pytest.raises(InvalidValueError, match="different frames"):
        write_scan(path, [scan, other])
    with pytest.raises(InvalidValueError, match="no chunk"):
        write_scan(path, [])
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(WorkspaceError, match="create the folder"):
        write_scan(tmp_path / "none" / "a", [scan])


def test_truncated_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    write_scan(path, [scan_of(5000)])
    content = path.read_bytes()
    for length in (100, 2000, len(content) // 2, len(content) - 1):
        path.write_bytes(content[:length])
        with pytest.raises(FormatError, match=r"a\.h5: is no whole native scan"):
            read_scan(path)


@pytest.mark.parametrize("name", ["place", "time", "range", "cube", "start", "intensity"])
def test_a_garbled_layer_fails_its_checksum(tmp_path: Path, name: str) -> None:
    path = tmp_path / "a.h5"
    write_scan(path, [scan_of(5000)])
    with h5py.File(path) as file:
        layer = file["block00000"][name]
        middle = layer.id.get_offset() + layer.nbytes // 2
    content = bytearray(path.read_bytes())
    content[middle] ^= 0xFF
    path.write_bytes(content)
    with pytest.raises(FormatError, match=rf"a\.h5: is no whole native scan \({name} fails"):
        read_scan(path)


def test_foreign_and_future_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["x"] = 1
    with pytest.raises(FormatError, match="but not 'SPCOLA scan'"):
        read_scan(path)
    write_scan(path, [scan_of(5)])
    with h5py.File(path, "a") as file:
        file.attrs["version"] = 99
    with pytest.raises(FormatError, match="version 99"):
        read_scan(path)


@pytest.mark.parametrize(
    ("place", "name", "value"),
    [
        ("block00000", "bits", 16),
        ("block00000", "time_start", 6e8 + 1e-3),
        ("block00000", "range_start", np.nan),
        ("/", "bounds_m", np.zeros((2, 3))),
        ("/", "parameters", '{"source": "elsewhere"}'),
        ("/", "version", 2),
    ],
)
def test_a_changed_attribute_fails_its_checksum(
    tmp_path: Path, place: str, name: str, value: object
) -> None:
    path = tmp_path / "a.h5"
    write_scan(path, [scan_of(5000)])
    with h5py.File(path, "a") as file:
        file[place].attrs.modify(name, value)
    for read in (scan_summary, read_scan):
        with pytest.raises(FormatError, match="attributes: fail their checksum"):
            read(path)


def test_no_text_lies_where_hdf5_keeps_no_checksum(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    write_scan(path, [scan_of(5000)])
    with h5py.File(path) as file:
        nodes = [file, *file.values()]
        types = [node.attrs.get_id(name).dtype for node in nodes for name in node.attrs]
    # Texts of variable length: a flipped bit among them makes HDF5 search without end.
    assert {kind.kind for kind in types} <= set("iufS")


def test_a_scan_of_the_version_without_that_checksum_is_read(tmp_path: Path) -> None:
    path, scan = tmp_path / "a.h5", scan_of(100)
    write_scan(path, [scan])
    with h5py.File(path, "a") as file:
        del file.attrs["seal"]
    with pytest.raises(FormatError, match="attributes: fail their checksum"):
        read_scan(path)
    with h5py.File(path, "a") as file:
        file.attrs.modify("version", 2)
    assert_same(read_scan(path), scan)


LAYERS = ["cube", "flag", "intensity", "place", "range", "spacecraft", "start", "time"]


@pytest.mark.parametrize("name", LAYERS)
def test_a_lost_or_short_layer_is_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / "a.h5"
    write_scan(path, [scan_of(5)])
    with h5py.File(path, "a") as file:
        assert sorted(file["block00000"]) == LAYERS
        short = file["block00000"][name][:-1]
        del file["block00000"][name]
        file["block00000"].create_dataset(name, data=short).attrs["crc32"] = crc32(short.data)
    with pytest.raises(FormatError, match=r"a\.h5: is no whole native scan"):
        read_scan(path)
    with h5py.File(path, "a") as file:
        del file["block00000"][name]
    with pytest.raises(FormatError, match=r"a\.h5: is no whole native scan"):
        read_scan(path)


@pytest.mark.parametrize(
    "name",
    [
        "count",
        "name",
        "trajectory",
        "body",
        "time_span_et_s",
        "bounds_m",
        "rejected",
        "version",
        "blocks",
    ],
)
def test_a_lost_attribute_is_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / "a.h5"
    write_scan(path, [scan_of(5)])
    with h5py.File(path, "a") as file:
        del file.attrs[name]
    with pytest.raises(FormatError, match=r"a\.h5: is no whole native scan"):
        read_scan(path)
