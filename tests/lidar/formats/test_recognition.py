"""Recognition, named formats, options, and files that cannot be read."""

from __future__ import annotations

from pathlib import Path

import pytest

from lidar.formats.options import LidarOptions
from lidar.formats.reader import open_lidar
from lidar.formats.recognise import FORMATS, recognise
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
