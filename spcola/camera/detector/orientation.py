"""Orientation of an image: how its lines and samples are to be shown."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from spcola.arrays import AnyArray
from spcola.errors import InvalidValueError


class Direction(StrEnum):
    """Direction on a display."""

    UP = "up"
    DOWN = "down"
    LEFT = "left"
    RIGHT = "right"


_VERTICAL = {Direction.UP, Direction.DOWN}


@dataclass(frozen=True)
class Orientation:
    """Directions in which line and sample numbers grow on a display.

    The first row of a file is line 1, whatever its label states: the display directions (PDS3's
    LINE_DISPLAY_DIRECTION and SAMPLE_DISPLAY_DIRECTION, PDS4's Display_Direction) state how the
    scene looks as through the camera. Shown as stored, lines go down and samples to the right.

    Parameters
    ----------
    line, sample : Direction
        One is vertical and the other horizontal.

    Raises
    ------
    InvalidValueError
        If both lie along one axis of the display.
    """

    line: Direction = Direction.DOWN
    sample: Direction = Direction.RIGHT

    def __post_init__(self) -> None:
        try:
            line, sample = Direction(self.line), Direction(self.sample)
        except ValueError as error:
            raise InvalidValueError(
                f"has directions {self.line!r} and {self.sample!r}",
                "orientation",
                "use up, down, left and right",
            ) from error
        if (line in _VERTICAL) == (sample in _VERTICAL):
            raise InvalidValueError(
                f"has lines going {line} and samples going {sample}: along one axis", "orientation"
            )
        object.__setattr__(self, "line", line)
        object.__setattr__(self, "sample", sample)

    @property
    def transposed(self) -> bool:
        """Whether lines are columns of the display."""
        return self.line not in _VERTICAL

    @property
    def first_corner(self) -> str:
        """Corner of the display that shows line 1, sample 1, such as ``lower left``."""
        vertical, horizontal = self._axes()
        return (
            f"{'upper' if vertical is Direction.DOWN else 'lower'} "
            f"{'left' if horizontal is Direction.RIGHT else 'right'}"
        )

    @property
    def mirrored(self) -> bool:
        """Whether the image as stored is a mirror image of the display, not a rotation of it."""
        vertical, horizontal = self._axes()
        flips = (vertical is Direction.UP) + (horizontal is Direction.LEFT) + self.transposed
        return flips % 2 == 1

    def apply(self, pixels: AnyArray) -> AnyArray:
        """Return the display (rows, columns) of pixels (lines, samples) as a view, no copy."""
        vertical, horizontal = self._axes()
        shown = pixels.T if self.transposed else pixels
        return shown[_step(vertical is Direction.UP), _step(horizontal is Direction.LEFT)]

    def undo(self, shown: AnyArray) -> AnyArray:
        """Return the pixels (lines, samples) of a display `shown` (rows, columns)."""
        vertical, horizontal = self._axes()
        pixels = shown[_step(vertical is Direction.UP), _step(horizontal is Direction.LEFT)]
        return pixels.T if self.transposed else pixels

    def _axes(self) -> tuple[Direction, Direction]:
        """Return the vertical and the horizontal direction."""
        return (self.sample, self.line) if self.transposed else (self.line, self.sample)


def _step(reverse: bool) -> slice:
    return slice(None, None, -1 if reverse else 1)
