"""Boulders with undercut sides and cliffs that lean out: maps of the ground onto a folded one.

Each takes the ground within a circle to a surface with several heights above the same place. The
map is continuous and leaves the ground outside the circle as it is, so that the mesh of a body
stays closed. Only sums, products and roots are used: the same body on every machine.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from spcola.arrays import FloatArray, IntArray

# The circle of ground that a boulder takes, in its longest semi-axes; and the share of its radius
# that becomes the boulder itself, which stretches boulder and ground about alike.
_BOULDER_GROUND, _BOULDER_SHARE = 1.35, 0.8
# Ground is stretched by up to this factor: edges have to be as much shorter before.
STRETCH = 2.6
# A boulder's smallest semi-axis has this many edges at least.
_EDGES = 6.0
# Length of the slope behind a cliff, in overhangs and heights: the ground is not folded there.
_BEHIND_OVERHANG, _BEHIND_HEIGHT = 5.0, 3.0
# Width of the strip that becomes the cliff's face, over the overhang.
_FACE = 0.25


@dataclass(frozen=True, eq=False)
class Patch:
    """A circle of ground.

    Attributes
    ----------
    origin : (3,) ndarray
        Its middle, on the ground, metres.
    axes : (3, 3) ndarray
        Rows: two unit vectors along the ground and its outward normal.
    reach : float
        Radius, metres.
    """

    origin: FloatArray
    axes: FloatArray
    reach: float

    def local(self, points: FloatArray) -> FloatArray:
        """Return `points` (N, 3) in the axes of the patch."""
        return (points - self.origin) @ self.axes.T

    def described(self, kind: str) -> dict[str, Any]:
        """Return kind and place of its feature in JSON types."""
        place, normal = self.origin.tolist(), self.axes[2].tolist()
        return {"kind": kind, "place_m": place, "normal": normal}

    def inside(self, points: FloatArray, margin: float = 0.0) -> IntArray:
        """Return the rows (M,) of the points (N, 3) that lie on this ground, or `margin` beyond."""
        reach = self.reach + margin
        rows = np.arange(len(points))
        # One coordinate after the other: most points are far away.
        for axis in range(3):
            rows = rows[np.abs(points[rows, axis] - self.origin[axis]) < 1.5 * reach]
        x, y, z = self.local(points[rows]).T
        return rows[(x * x + y * y < reach**2) & (np.abs(z) < reach)]


@dataclass(frozen=True, eq=False)
class UndercutBoulder:
    """An ellipsoid, slightly irregular, of which more than half stands above the ground.

    Attributes
    ----------
    patch : Patch
        Its axes are those of the ellipsoid.
    semi_axes : tuple of 3 float
        Along them, metres.
    quarter_tangent : float
        Tangent of a quarter of the angle from its top to the ground, seen from its middle.
    bumps : (4, 3) ndarray
        Direction and strength of its bumps; zero for an ellipsoid.
    """

    patch: Patch
    semi_axes: tuple[float, float, float]
    quarter_tangent: float
    bumps: FloatArray

    @property
    def edge(self) -> float:
        """Longest edge for its form, metres, after the ground has been stretched."""
        return min(self.semi_axes) / _EDGES

    def described(self) -> dict[str, Any]:
        """Return kind, place and size in JSON types."""
        return {**self.patch.described("boulder"), "semi_axes_m": list(self.semi_axes)}

    def roughness_left(self, points: FloatArray) -> FloatArray:
        """Return the share (N,) of the ground's relief that remains at points (N, 3) inside."""
        x, y, _ = self.patch.local(points).T
        share = np.sqrt(x * x + y * y) / self.patch.reach
        return smooth_step((share - _BOULDER_SHARE) / (1.0 - _BOULDER_SHARE))

    def moved(self, points: FloatArray) -> FloatArray:
        """Return the places (N, 3) of points (N, 3) of the ground inside the circle."""
        x, y, z = self.patch.local(points).T
        away = np.sqrt(x * x + y * y)
        east, north = (side / np.maximum(away, 1e-12) for side in (x, y))
        share = away / self.patch.reach
        a, b, c = self.semi_axes
        sine, cosine = _sine_cosine(np.minimum(share / _BOULDER_SHARE, 1.0) * self.quarter_tangent)
        foot_sine, foot_cosine = _sine_cosine(np.array(self.quarter_tangent))
        swell = self._swell(np.stack([sine * east, sine * north, cosine]), share / _BOULDER_SHARE)
        out = np.clip((share - _BOULDER_SHARE) / (1.0 - _BOULDER_SHARE), 0.0, 1.0)
        on_ground = out > 0.0
        radius = self.patch.reach
        foot_x, foot_y = a * foot_sine * east, b * foot_sine * north
        new = np.stack([
            np.where(on_ground, foot_x + out * (radius * east - foot_x), a * swell * sine * east),
            np.where(on_ground, foot_y + out * (radius * north - foot_y), b * swell * sine * north),
            z + np.where(on_ground, 0.0, c * (swell * cosine - foot_cosine)),
        ], axis=1)  # fmt: skip
        return self.patch.origin + new @ self.patch.axes

    def _swell(self, direction: FloatArray, share: FloatArray) -> FloatArray:
        """Return the factor (N,) of the radius in directions (3, N): 1 at the ground."""
        bump = np.sum((self.bumps @ direction) ** 3, axis=0)
        return 1.0 + bump * np.maximum(1.0 - share * share, 0.0)


@dataclass(frozen=True, eq=False)
class Cliff:
    """Ground raised along a line and pushed over its edge.

    All ground moves along one slanted vector, up and outward; in front of the edge the share of it
    rises over a strip narrower than the push, so that the face leans out over the ground before it.

    Attributes
    ----------
    patch : Patch
        x runs along the edge, y up the slope behind it.
    length, height, overhang : float
        Metres; the height and the overhang are those in the middle.
    """

    patch: Patch
    length: float
    height: float
    overhang: float

    @property
    def edge(self) -> float:
        """Longest edge for its form, metres, after the ground has been stretched."""
        return self.overhang / _EDGES

    def described(self) -> dict[str, Any]:
        """Return kind, place and size in JSON types."""
        size = [self.length, self.height, self.overhang]
        return {**self.patch.described("cliff"), "length_height_overhang_m": size}

    def roughness_left(self, points: FloatArray) -> FloatArray:
        """Return the share (N,) of the relief that remains: all of it but on the face."""
        x, y, _ = self.patch.local(points).T
        face = _FACE * self.overhang
        near = np.maximum(np.abs(y) / (4.0 * face), np.abs(x) / (0.6 * self.length))
        return smooth_step(near)

    def moved(self, points: FloatArray) -> FloatArray:
        """Return the places (N, 3) of points (N, 3) of the ground inside the circle."""
        x, y, _ = self.patch.local(points).T
        face, behind = _FACE * self.overhang, _behind(self.height, self.overhang)
        along = np.maximum(1.0 - (2.0 * x / self.length) ** 2, 0.0) ** 2
        up = smooth_step((y + face) / (2.0 * face))
        down = smooth_step((behind - y) / (behind - face))
        share = along * np.where(y < face, up, down)
        push = self.height * self.patch.axes[2] - self.overhang * self.patch.axes[1]
        moved: FloatArray = points + share[:, None] * push
        return moved


def ground_of_boulder(semi_axes: tuple[float, float, float]) -> float:
    """Return the radius of the ground that a boulder of these semi-axes takes, metres."""
    return _BOULDER_GROUND * max(semi_axes)


def ground_of_cliff(length: float, height: float, overhang: float) -> float:
    """Return the radius of the ground that a cliff of this size takes, metres."""
    behind = _behind(height, overhang)
    return float(np.sqrt(0.25 * length * length + behind * behind))


Overhang = UndercutBoulder | Cliff
"""A feature with several heights above one place."""


def smooth_step(share: FloatArray) -> FloatArray:
    """Return 0 below 0, 1 above 1, and ``3 s² − 2 s³`` between."""
    s = np.clip(share, 0.0, 1.0)
    step: FloatArray = s * s * (3.0 - 2.0 * s)
    return step


def _behind(height: float, overhang: float) -> float:
    return max(_BEHIND_OVERHANG * overhang, _BEHIND_HEIGHT * height)


def _sine_cosine(quarter: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return sine and cosine of four times the angle whose tangent is `quarter`."""
    square = quarter * quarter
    sine, cosine = 2.0 * quarter / (1.0 + square), (1.0 - square) / (1.0 + square)
    return 2.0 * sine * cosine, cosine * cosine - sine * sine
