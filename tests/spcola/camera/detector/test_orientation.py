"""Orientation: the eight ways to show an image."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from spcola.camera.detector import Direction, Orientation
from spcola.errors import InvalidValueError

VERTICAL = (Direction.UP, Direction.DOWN)
EIGHT = [
    Orientation(line, sample)
    for line, sample in product(Direction, Direction)
    if (line in VERTICAL) != (sample in VERTICAL)
]
PIXELS = np.arange(6).reshape(2, 3)
STEP = {"up": (-1, 0), "down": (1, 0), "left": (0, -1), "right": (0, 1)}


def test_there_are_eight_ways_all_different() -> None:
    assert len(EIGHT) == 8
    square = np.arange(4).reshape(2, 2)
    assert len({orientation.apply(square).tobytes() for orientation in EIGHT}) == 8


@pytest.mark.parametrize("orientation", EIGHT, ids=str)
def test_lines_and_samples_grow_as_stated(orientation) -> None:
    shown = orientation.apply(PIXELS)
    first = np.argwhere(shown == PIXELS[0, 0])[0]
    line = np.argwhere(shown == PIXELS[1, 0])[0] - first
    sample = np.argwhere(shown == PIXELS[0, 1])[0] - first
    assert tuple(line) == STEP[orientation.line]
    assert tuple(sample) == STEP[orientation.sample]
    vertical, horizontal = orientation.first_corner.split()
    assert (first[0] == 0) == (vertical == "upper")
    assert (first[1] == 0) == (horizontal == "left")
    # Down × right is the handedness of a file shown as it is stored.
    handedness = line[0] * sample[1] - line[1] * sample[0]
    assert orientation.mirrored == (handedness < 0)


@pytest.mark.parametrize("orientation", EIGHT, ids=str)
def test_undo_agrees_with_apply(orientation) -> None:
    shown = orientation.apply(PIXELS)
    np.testing.assert_array_equal(orientation.undo(shown), PIXELS)


def test_words_are_directions_and_one_axis_is_refused() -> None:
    assert Orientation("up", "left") == Orientation(Direction.UP, Direction.LEFT)  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError, match="along one axis"):
        Orientation(Direction.UP, Direction.DOWN)
    with pytest.raises(InvalidValueError, match="use up, down, left and right"):
        Orientation("north", "left")  # type: ignore[arg-type]
