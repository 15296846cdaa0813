"""Recognition, named formats, options, and files that cannot be read."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from lidar.formats import open_lidar, recognise
from lidar.formats.missions import write_ola
from lidar.formats.native import write_scan
from lidar.formats.recognition import FORMATS
from lidar.formats.records import LidarOptions
from lidar.scans import Scan
from spcola.errors import FormatError, SettingsError


def test_unknown_content_lists_the_formats(tmp_path: Path) -> None:
    path = tmp_path / "scan.ola"
    path.write_text("Dear reader,\nthis is a letter.\n")
    with pytest.raises(FormatError) as caught:
        recognise(path)
    message = str(caught.value)
    assert "scan.ola: has no known lidar format" in message
    assert "\n" not in message
    assert all(name in message for name in FORMATS)


def test_an_unknown_name_lists_the_formats(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="'olla' is no lidar format; use one of native"):
        open_lidar(tmp_path / "a", format="olla")


@pytest.mark.parametrize("name", [None, *FORMATS])
def test_missing_files_and_folders_are_named(tmp_path: Path, name: str | None) -> None:
    for path in (tmp_path, tmp_path / "none"):
        with pytest.raises(FormatError, match=path.name):
            list(open_lidar(path, format=name))


@pytest.mark.parametrize("name", [None, *FORMATS])
def test_empty_files_are_refused(tmp_path: Path, name: str | None) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"")
    with pytest.raises(FormatError):
        list(open_lidar(path, format=name))


@pytest.mark.parametrize(
    "bad",
    [
        {"chunk": 0},
        {"sigma_m": 0.0},
        {"sigma_m": float("inf")},
        {"unit": "ft"},
        {"range_tolerance_m": -1.0},
        {"reference_offset_m": float("nan")},
        {"radius_limits_m": (2.0, 1.0)},
    ],
)
def test_bad_options_are_refused(bad: dict[str, object]) -> None:
    with pytest.raises(SettingsError, match=next(iter(bad))):
        LidarOptions(**bad)  # type: ignore[arg-type]


def write_table(path: Path, scans: list[Scan]) -> None:
    np.savetxt(path, scans[0].points, delimiter=",", header="x_m,y_m,z_m", comments="")


@pytest.mark.parametrize("write", [write_ola, write_scan, write_table])
def test_memory_is_bounded_by_the_chunk(
    tmp_path: Path, write: Callable[[Path, list[Scan]], object]
) -> None:
    count, chunk = 60_000, 500
    points = np.random.default_rng(2).normal(size=(count, 3)) * 250
    scan = Scan.of_points("a", points, spacecraft=points * 3, time=np.full(count, 6e8))
    write(tmp_path / "a", [scan])
    list(open_lidar(tmp_path / "a", options=LidarOptions(chunk=count)))  # imports and caches
    tracemalloc.start()
    found = sum(len(part) for part in open_lidar(tmp_path / "a", options=LidarOptions(chunk=chunk)))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found == count
    # A return takes at most 14 numbers in a scan; some ten times as much comes and goes.
    assert peak < 2_000_000 < scan.points.nbytes * 14 / 3
