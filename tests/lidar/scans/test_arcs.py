"""Long scans cut into arcs of time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lidar.formats.native import write_scan
from lidar.scan_store import ScanStore
from lidar.scans import Arcs, Scan
from lidar.scans.cubes import Box


def test_a_span_is_cut_into_equal_arcs_that_are_short_enough() -> None:
    arcs = Arcs.of_span((100.0, 1000.0), 400.0)
    assert (arcs.count, arcs.width) == (3, 300.0)
    times = np.array([100.0, 399.9, 400.1, 1000.0, np.nan, 1000.1])
    assert arcs.numbers(times).tolist() == [0, 0, 1, 2, 0, 2]
    assert arcs.names("track") == ["track:1", "track:2", "track:3"]


@pytest.mark.parametrize("span", [(100.0, 500.0), (5.0, 5.0), (np.nan, np.nan)])
def test_short_spans_and_unknown_ones_stay_whole(span: tuple[float, float]) -> None:
    arcs = Arcs.of_span(span, 400.0)
    assert arcs.count == 1
    assert arcs.names("scan") == ["scan"]
    assert arcs.numbers(np.array([0.0, 1e9, np.nan])).tolist() == [0, 0, 0]


def test_names_of_many_arcs_sort_as_the_arcs_do() -> None:
    names = Arcs.of_span((0.0, 1200.0), 100.0).names("t")
    assert names == sorted(names)
    assert names[0] == "t:01"


def test_a_store_numbers_returns_by_arc(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(-40, 40, (900, 3))
    track = replace(Scan.of_points("track", points), time=np.linspace(5e8, 5e8 + 3599.0, 900))
    raster = replace(Scan.of_points("raster", points + 1.0), time=np.full(900, 5e8))
    paths = []
    for scan in (track, raster):
        write_scan(path := tmp_path / scan.name, [scan.select(slice(0, 500)),
                                                  scan.select(slice(500, None))])  # fmt: skip
        paths.append(path)
    store = ScanStore(paths, arc_s=1200.0)
    assert store.scan_names == ("track:1", "track:2", "track:3", "raster")
    assert store.arcs.scan.tolist() == [0, 0, 0, 1]
    everywhere = Box(np.zeros(3), np.eye(3), np.full(3, 100.0))
    found = store.returns_inside(everywhere)
    assert np.bincount(found.scan).tolist() == [300, 300, 300, 900]
    for number in range(3):
        mine = found.points[found.scan == number]
        truth = points[300 * number : 300 * (number + 1)]
        assert np.abs(np.sort(mine, axis=0) - np.sort(truth, axis=0)).max() < 1e-4
        assert store.arcs.center[number] == pytest.approx(truth.mean(axis=0), abs=1e-4)
    whole = ScanStore(paths)
    assert whole.scan_names == ("track", "raster")
    assert store.without_place == whole.without_place == {"track": 0, "raster": 0}
