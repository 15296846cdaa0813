"""The eight orientations of a frame, by name."""

from __future__ import annotations

from enum import StrEnum

from spcola.camera.detector import Direction, Orientation

_UP, _DOWN, _LEFT, _RIGHT = Direction.UP, Direction.DOWN, Direction.LEFT, Direction.RIGHT


class Turn(StrEnum):
    """What is done to the pixels of a file before they are those of the camera."""

    AS_STORED = "as-stored"
    MIRRORED_SAMPLES = "mirrored-samples"
    MIRRORED_LINES = "mirrored-lines"
    HALF_TURN = "half-turn"
    TRANSPOSED = "transposed"
    QUARTER_TURN_RIGHT = "quarter-turn-right"
    QUARTER_TURN_LEFT = "quarter-turn-left"
    ANTI_TRANSPOSED = "anti-transposed"

    @property
    def orientation(self) -> Orientation:
        """Directions of line and sample numbers on the camera's frame."""
        return _ORIENTATIONS[self]

    @property
    def mirrored(self) -> bool:
        """Whether it is a mirror image, not a rotation."""
        return self.orientation.mirrored

    @property
    def exchanges(self) -> bool:
        """Whether lines become columns."""
        return self.orientation.transposed


_ORIENTATIONS = {
    Turn.AS_STORED: Orientation(_DOWN, _RIGHT),
    Turn.MIRRORED_SAMPLES: Orientation(_DOWN, _LEFT),
    Turn.MIRRORED_LINES: Orientation(_UP, _RIGHT),
    Turn.HALF_TURN: Orientation(_UP, _LEFT),
    Turn.TRANSPOSED: Orientation(_RIGHT, _DOWN),
    Turn.QUARTER_TURN_RIGHT: Orientation(_LEFT, _DOWN),
    Turn.QUARTER_TURN_LEFT: Orientation(_RIGHT, _UP),
    Turn.ANTI_TRANSPOSED: Orientation(_LEFT, _UP),
}
