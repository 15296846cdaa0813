"""Occlusion over a grid of heights: of the Sun, or of an eye."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import BoolArray, FloatArray
from spcola.compilation import compiled

# Rays that rise faster than the steepest ground, by more than rounding, never meet it.
_STEEPER = 1.0 + 1e-6


@dataclass(frozen=True)
class Relief:
    """What limits how far rays over heights have to be followed.

    Attributes
    ----------
    top : float
        Highest height; −∞ without any.
    steepest : float
        Slope, a grid step, from which on rays meet no ground. Infinite with gaps: across them
        ground may rise by anything.
    """

    top: float
    steepest: float

    @classmethod
    def of(cls, height: FloatArray) -> Relief:
        """Return that of heights (R, C); NaN where unknown."""
        known = np.isfinite(height)
        if known.all():
            return cls(float(height.max()), _STEEPER * _steepest(height))
        return cls(float(np.max(height, where=known, initial=-np.inf)), np.inf)


def cast_shadow(height: FloatArray, sun: FloatArray, relief: Relief | None = None) -> BoolArray:
    """Return which points of a grid lie in the shadow of others.

    Parameters
    ----------
    height : (R, C) ndarray
        NaN where unknown: nothing stands there.
    sun : (3,) ndarray
        Direction of the Sun along columns, rows and up, in grid steps and the unit of `height`:
        for a unit vector s in maplet axes and heights in metres, (s_x, s_y, gsd · s_z).
    relief : Relief, optional
        Of the heights, if it is there.

    Returns
    -------
    (R, C) ndarray of bool
        All where the Sun is below the plane's horizon; unknown points are never in shadow.
    """
    if sun[2] <= 0.0:
        return np.isfinite(height)
    dark = np.zeros(height.shape, dtype=np.bool_)
    run = float(np.hypot(sun[0], sun[1]))
    relief = relief or Relief.of(height)
    if run > 0.0 and not sun[2] > run * relief.steepest:
        _march(height, sun[0] / run, sun[1] / run, sun[2] / run, relief.top, dark)
    return dark


def hidden(height: FloatArray, eye: FloatArray, relief: Relief | None = None) -> BoolArray:
    """Return which points of a grid others hide from an eye at a finite distance.

    Parameters
    ----------
    height : (R, C) ndarray
        NaN where unknown: nothing stands there.
    eye : (3,) ndarray
        Its position: along columns and rows in grid steps from the grid's first point, and up, in
        the unit of `height`.
    relief : Relief, optional
        Of the heights, if it is there.

    Returns
    -------
    (R, C) ndarray of bool
        Unknown points are never hidden.
    """
    behind = np.zeros(height.shape, dtype=np.bool_)
    relief = relief or Relief.of(height)
    last = np.array(height.shape[::-1]) - 1.0
    farthest = float(np.hypot(*np.maximum(np.abs(eye[:2]), np.abs(eye[:2] - last))))
    if not eye[2] - relief.top > farthest * relief.steepest:
        _march_to(height, eye, relief.top, relief.steepest, behind)
    return behind


@compiled
def _steepest(height: FloatArray) -> float:
    """Return the largest slope of bilinear heights, all known, a grid step.

    Along columns and along rows a cell's slope is at most that of the steeper of its edges.
    """
    # A maximum for each column, rather than one, is vectorised.
    squares = np.zeros(height.shape[1])
    for i in range(height.shape[0] - 1):
        here, below = height[i], height[i + 1]
        for j in range(height.shape[1] - 1):
            across = max(abs(here[j + 1] - here[j]), abs(below[j + 1] - below[j]))
            down = max(abs(below[j] - here[j]), abs(below[j + 1] - here[j + 1]))
            squares[j] = max(squares[j], across * across + down * down)
    return float(np.sqrt(squares.max()))


@compiled
def _march(
    height: FloatArray, across: float, along: float, rise: float, top: float, dark: BoolArray
) -> None:
    """Follow the ray from each point to the Sun."""
    for row in range(height.shape[0]):
        for column in range(height.shape[1]):
            dark[row, column] = _met(height, row, column, across, along, rise, top)


@compiled
def _march_to(
    height: FloatArray, eye: FloatArray, top: float, steepest: float, behind: BoolArray
) -> None:
    """Follow the ray from each point to an eye; points straight below it are never hidden."""
    for row in range(height.shape[0]):
        for column in range(height.shape[1]):
            across, along, up = eye[0] - column, eye[1] - row, eye[2] - height[row, column]
            run = np.sqrt(across * across + along * along)
            if run > 1.0 and up <= steepest * run:
                behind[row, column] = up <= 0.0 or _met(
                    height, row, column, across / run, along / run, up / run, top
                )


@compiled
def _met(
    height: FloatArray,
    row: int,
    column: int,
    across: float,
    along: float,
    rise: float,
    top: float,
) -> bool:
    """Whether a rising ray meets ground, one grid step at a time, over bilinear heights."""
    rows, columns = height.shape
    x, y, ray = float(column), float(row), height[row, column]
    while ray <= top:
        x, y, ray = x + across, y + along, ray + rise
        left, low = int(np.floor(x)), int(np.floor(y))
        if left < 0 or low < 0 or left + 1 >= columns or low + 1 >= rows:
            return False
        u, v = x - left, y - low
        ground = (1.0 - v) * ((1.0 - u) * height[low, left] + u * height[low, left + 1]) + v * (
            (1.0 - u) * height[low + 1, left] + u * height[low + 1, left + 1]
        )
        if ground > ray:
            return True
    return False
