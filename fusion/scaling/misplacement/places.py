"""Other places of the shots, with which their stated positions are compared."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from spcola.arrays import FloatArray

# Steps of rotations about Z, mirrored ones, and about axes in the equator, degrees.
_STEP_DEG, _MIRRORED_DEG, _COARSE_DEG = 2.0, 3.0, 4.0
# Smallest rotation from the stated position of a wrong place.
_ELSEWHERE_DEG = 20.0
Z = np.array([0.0, 0.0, 1.0])
_MIRRORS = {
    "": (1.0, 1.0, 1.0),
    "longitude of the other sign": (1.0, -1.0, 1.0),
    "north for south": (1.0, 1.0, -1.0),
    "through the centre": (-1.0, -1.0, -1.0),
}


@dataclass(frozen=True, eq=False)
class Place:
    """Another place for the shots: a rotation about an axis, after mirroring.

    Parameters
    ----------
    axis : (3,) ndarray
        Unit vector, body-fixed.
    turn_deg : float
        Right-handed rotation about it.
    mirrored : str
        Name of the mirroring applied before; empty for none.
    """

    axis: FloatArray
    turn_deg: float
    mirrored: str = ""

    @property
    def matrix(self) -> FloatArray:
        """Matrix (3, 3) that takes the shots there."""
        turn = Rotation.from_rotvec(np.radians(self.turn_deg) * self.axis).as_matrix()
        matrix: FloatArray = turn @ np.diag(_MIRRORS[self.mirrored])
        return matrix

    @property
    def signed_deg(self) -> float:
        """The rotation in [−180, 180), degrees."""
        return (self.turn_deg + 180.0) % 360.0 - 180.0

    @property
    def is_elsewhere(self) -> bool:
        """Whether it is far enough from the stated position to be a wrong place."""
        return bool(self.mirrored) or abs(self.signed_deg) > _ELSEWHERE_DEG

    @property
    def about_z(self) -> bool:
        """Whether it is only a rotation about the body's Z axis."""
        return not self.mirrored and bool(self.axis[2] == 1.0)

    def __str__(self) -> str:
        turn = self.signed_deg
        axis = "Z" if self.axis[2] == 1.0 else f"({', '.join(f'{x:.2f}' for x in self.axis)})"
        parts = [f"mirrored ({self.mirrored})"] if self.mirrored else []
        parts += [f"turned by {turn:+.1f} deg about {axis}"] if turn or not parts else []
        return " and ".join(parts)


def trial_places(points: FloatArray) -> Iterator[Place]:
    """Yield rotations of `points` (N, 3) about Z, also mirrored, and about axes in the equator."""
    for mirrored in _MIRRORS:
        for turn in np.arange(0.0, 360.0, _MIRRORED_DEG if mirrored else _STEP_DEG):
            if turn or mirrored:
                yield Place(Z, float(turn), mirrored)
    middle = points.mean(axis=0)
    toward = np.arctan2(middle[1], middle[0])
    # Rotations about the fifth axis move the shots north and south.
    for number in range(8):
        angle = toward + np.pi / 8.0 * number
        axis = np.array([np.cos(angle), np.sin(angle), 0.0])
        step = _STEP_DEG if number == 4 else _COARSE_DEG
        for turn in np.arange(step, 360.0, step):
            yield Place(axis, float(turn))
