"""The returns of many scans, asked for by place."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lidar.formats.native import ScanFile, write_scan
from lidar.geolocation import find_geolocation
from lidar.gridding import GriddingOptions, grid_returns
from lidar.scan_store import ScanStore
from lidar.scans import Returns, Scan
from lidar.scans.cubes import QUANTUM_M, Box
from spcola.errors import FormatError, InvalidValueError
from spcola.grids import MapletGrid
from spcola.navigation import Trajectory


def sphere(rng: np.random.Generator, count: int) -> np.ndarray:
    points = rng.normal(size=(count, 3))
    return 50.0 * points / np.linalg.norm(points, axis=1, keepdims=True)


@pytest.fixture
def scans() -> list[Scan]:
    rng = np.random.default_rng(1)
    first, second = (
        Scan.of_points(name, sphere(rng, count), sigma=rng.uniform(0.01, 0.02, count))
        for name, count in (("first", 6500), ("second", 3000))
    )
    return [
        first,
        second,
        Scan.of_points("shots", sphere(rng, 12)),
        Scan.of_points("none", np.empty((0, 3))),
    ]


@pytest.fixture
def paths(scans: list[Scan], tmp_path: Path) -> list[Path]:
    for scan in scans:
        # Chunks of a scan are blocks of its file.
        write_scan(
            tmp_path / scan.name, [scan.select(slice(0, 2500)), scan.select(slice(2500, None))]
        )
    return [tmp_path / scan.name for scan in scans]


def rows(returns: Returns) -> set[tuple[object, ...]]:
    """Returns as a set: rounded places, sigma to single precision, name of the scan."""
    place = np.rint(returns.points / QUANTUM_M).astype(int).tolist()
    sigma = np.nan_to_num(returns.sigma.astype(np.float32), nan=-1.0).tolist()
    names = (returns.scan_names[number] for number in returns.scan)
    return {(*p, s, n) for p, s, n in zip(place, sigma, names, strict=True)}


def cube_at(center: list[float], half: float) -> Box:
    return Box(np.array(center), np.eye(3), np.full(3, half))


def test_returns_inside_a_box_are_all_there(paths: list[Path], scans: list[Scan]) -> None:
    store = ScanStore(paths)
    everything = Returns.of_scans(scans)
    assert len(store) == len(everything)
    assert store.scan_names == ("first", "second", "shots", "none")
    for center in ([50.0, 0.0, 0.0], [-20.0, 30.0, -35.0], [0.0, 0.0, 0.0]):
        for half in (3.0, 12.0, 60.0):
            box = cube_at(center, half)
            inside = everything.select(box.holds(everything.points))
            assert rows(store.returns_inside(box)) == rows(inside)
            assert store.count_inside(box) >= len(inside)


def test_memory_of_files_is_given_back_and_mapped_again(
    paths: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """… as a mission has more returns than memory; the result is the same."""
    box, given_back = cube_at([50.0, 0.0, 0.0], 12.0), []
    store = ScanStore(paths)
    first = store.returns_inside(box)
    monkeypatch.setattr("lidar.scan_store._MOST_MAPPED_BYTES", 0)
    monkeypatch.setattr(
        ScanFile,
        "release",
        lambda file, release=ScanFile.release: (given_back.append(file), release(file)),
    )
    for _ in range(2):
        again = store.returns_inside(box)
        np.testing.assert_array_equal(again.points, first.points)
    assert len(given_back) == 2 * len(paths)


def test_mapolas_from_the_store_are_those_from_memory(paths: list[Path], scans: list[Scan]) -> None:
    grid = MapletGrid.facing([50.0, 0.0, 0.0], [1.0, 0.0, 0.0], 1.0, 12)
    options = GriddingOptions()
    near = ScanStore(paths).returns_inside(options.box(grid))
    stored = grid_returns("M", grid, near, options=options).mapola
    direct = grid_returns("M", grid, Returns.of_scans(scans), options=options).mapola
    # A return that rounding carries into the next cell counts there.
    assert np.mean(stored.count == direct.count) > 0.99
    same = stored.count == direct.count
    assert same.all() or np.abs(stored.count - direct.count)[~same].max() == 1
    np.testing.assert_allclose(stored.height[same], direct.height[same], rtol=0, atol=2 * QUANTUM_M)


def test_returns_are_found_where_another_trajectory_puts_them(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    points, time = sphere(rng, 8000), 6e8 + rng.uniform(0.0, 100.0, 8000)
    station = np.column_stack([500.0 + 0.0 * time, 0.1 * (time - 6e8), 0.0 * time])
    scan = Scan.of_points("scan", points, time=time, spacecraft=station)
    write_scan(tmp_path / "scan", [scan.select(slice(0, 5000)), scan.select(slice(5000, None))])
    states = 6e8 + np.array([20.0, 50.0, 90.0])
    shift = np.array([[3.0, 0.0, 0.0], [0.0, -4.0, 1.0], [2.0, 2.0, 2.0]])
    there = np.column_stack([np.full(3, 500.0), 0.1 * (states - 6e8), np.zeros(3)])
    spc = Trajectory("spc", states, there + shift)
    store = ScanStore(
        [tmp_path / "scan"],
        locate=lambda file: find_geolocation(file.trajectory(), 60.0, trajectory=spc),
    )
    covered = (time >= states[0]) & (time <= states[-1])
    moved = points + np.column_stack([np.interp(time, states, shift[:, k]) for k in range(3)])
    assert store.without_place == {"scan": int(np.count_nonzero(~covered))}
    for box in (cube_at([50.0, 0.0, 0.0], 15.0), cube_at([0.0, -36.0, 36.0], 4.0)):
        right = moved[covered & box.holds(moved)]
        found = store.returns_inside(box).points
        assert len(found) == len(right) > 0
        np.testing.assert_allclose(np.sort(found, axis=0), np.sort(right, axis=0), atol=1e-4)
    spread = store.spread(len(store))
    right = moved[covered]
    np.testing.assert_allclose(np.sort(spread, axis=0), np.sort(right, axis=0), atol=1e-4)


def test_a_scan_is_replaced_and_the_others_are_not_touched(
    paths: list[Path], scans: list[Scan]
) -> None:
    before = paths[0].read_bytes()
    write_scan(paths[1], [Scan.of_points("second", scans[1].points[:100])])
    store = ScanStore(paths)
    assert len(store) == 6500 + 100 + 12
    assert paths[0].read_bytes() == before


def test_middles_are_those_of_the_scans(paths: list[Path], scans: list[Scan]) -> None:
    middles = ScanStore(paths).arcs.center
    for middle, scan in zip(middles, scans, strict=True):
        box = (scan.points.min(axis=0) + scan.points.max(axis=0)) / 2 if len(scan) else [0, 0, 0]
        np.testing.assert_allclose(middle, box, atol=1e-12)


def test_what_does_not_go_together_is_refused(paths: list[Path], tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match="is the scan of two files"):
        ScanStore([paths[0], paths[0]])
    other = tmp_path / "other"
    write_scan(other, [Scan.of_points("other", np.zeros((3, 3)), body="elsewhere")])
    with pytest.raises(InvalidValueError, match="different frames"):
        ScanStore([*paths, other])
    with pytest.raises(FormatError):
        ScanStore([tmp_path / "absent"])


def test_without_scans_there_are_no_returns() -> None:
    store = ScanStore([])
    assert len(store) == 0
    assert len(store.returns_inside(cube_at([0.0, 0.0, 0.0], 1e9))) == 0


def test_a_few_returns_are_spread_over_all_scans(paths: list[Path], scans: list[Scan]) -> None:
    store = ScanStore(paths)
    everything = store.spread(len(store))
    points = np.concatenate([scan.points for scan in scans])
    assert everything.shape == points.shape
    for found, there in zip(everything.T, points.T, strict=True):
        np.testing.assert_allclose(np.sort(found), np.sort(there), atol=QUANTUM_M)
    few = store.spread(1000)
    assert 900 <= len(few) <= 1000
    # Octants hold their share.
    octant = np.bincount((few > 0.0) @ [1, 2, 4], minlength=8)
    assert octant.min() > 0.6 * len(few) / 8
    assert ScanStore([]).spread(10).shape == (0, 3)
