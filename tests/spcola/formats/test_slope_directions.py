"""Companion with the directions of slopes that images determine: bytes, and damaged files."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from spcola.errors import FormatError
from spcola.formats.slope_directions import (
    SlopeDirections,
    read_slope_directions,
    slope_directions_path,
    write_slope_directions,
)

COUNT = np.array([[0, 1], [2, 1]], dtype=np.int8)
AZIMUTH = np.array([[np.nan, 12.5], [np.nan, 180.0]])
# Columns first, as in the .MAP: numbers of directions, then azimuths.
BYTES = struct.pack(">8f", 0, 2, 1, 1, np.nan, np.nan, 12.5, 180.0)


def test_numbers_of_directions_come_first_then_azimuths_in_the_order_of_the_map(tmp_path):
    write_slope_directions(tmp_path / "AB0001.MAP", SlopeDirections(COUNT, AZIMUTH))
    path = slope_directions_path(tmp_path / "AB0001.MAP")
    assert path.name == "AB0001.SDR"
    assert path.read_bytes() == BYTES
    found = read_slope_directions(path, 1)
    np.testing.assert_array_equal(found.count, COUNT)
    np.testing.assert_array_equal(found.undetermined_azimuth_deg, AZIMUTH)
    assert found.count.dtype == np.int8


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        (0, 3.0, "none of 0, 1 and 2"),
        (1, np.nan, "none of 0, 1 and 2"),
        (2, 0.5, "none of 0, 1 and 2"),
        (4, 90.0, "do not belong to cells with one direction"),
        (6, np.nan, "do not belong to cells with one direction"),
        (6, np.inf, "do not belong to cells with one direction"),
        (7, 180.5, "do not belong to cells with one direction"),
        (7, -1.0, "do not belong to cells with one direction"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path, place, value, words):
    path = tmp_path / "AB0001.SDR"
    numbers = list(struct.unpack(">8f", BYTES))
    numbers[place] = value
    path.write_bytes(struct.pack(">8f", *numbers))
    with pytest.raises(FormatError, match=words):
        read_slope_directions(path, 1)


def test_a_file_of_another_size_is_refused(tmp_path):
    path = tmp_path / "AB0001.SDR"
    path.write_bytes(BYTES[:-1])
    with pytest.raises(FormatError, match="31 bytes, 32 belong to q = 1"):
        read_slope_directions(path, 1)


def test_points_have_the_fewest_directions_around():
    count = np.array([[2, 1], [2, 0]], dtype=np.int8)
    found = SlopeDirections(count, np.where(count == 1, 30.0, np.nan))
    np.testing.assert_array_equal(found.count_at_points, [[2, 1, 1], [2, 0, 0], [2, 0, 0]])
