"""Occlusion over a grid of heights: of the Sun, or of an eye."""

from __future__ import annotations

import numpy as np

from spcola.arrays import BoolArray, FloatArray
from spcola.compilation import compiled


def cast_shadow(height: FloatArray, sun: FloatArray) -> BoolArray:
    """Return which points of a grid lie in the shadow of others.

    Parameters
    ----------
    height : (R, C) ndarray
        NaN where unknown: nothing stands there.
    sun : (3,) ndarray
        Direction of the Sun along columns, rows and up, in grid steps and the unit of `height`:
        for a unit vector s in maplet axes and heights in metres, (s_x, s_y, gsd · s_z).

    Returns
    -------
    (R, C) ndarray of bool
        All where the Sun is below the plane's horizon; unknown points are never in shadow.
    """
    if sun[2] <= 0.0:
        return np.isfinite(height)
    dark = np.zeros(height.shape, dtype=np.bool_)
    run = float(np.hypot(sun[0], sun[1]))
    if run == 0.0 or not np.isfinite(height).any():
        return dark
    step = np.array([sun[0], sun[1], sun[2]]) / run
    _march(height, step[0], step[1], step[2], float(np.nanmax(height)), dark)
    return dark


def hidden(height: FloatArray, eye: FloatArray) -> BoolArray:
    """Return which points of a grid others hide from an eye at a finite distance.

    Parameters
    ----------
    height : (R, C) ndarray
        NaN where unknown: nothing stands there.
    eye : (3,) ndarray
        Its position: along columns and rows in grid steps from the grid's first point, and up, in
        the unit of `height`.

    Returns
    -------
    (R, C) ndarray of bool
        Unknown points are never hidden.
    """
    behind = np.zeros(height.shape, dtype=np.bool_)
    if np.isfinite(height).any():
        _march_to(height, eye[0], eye[1], eye[2], float(np.nanmax(height)), behind)
    return behind


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
    height: FloatArray, x: float, y: float, up: float, top: float, behind: BoolArray
) -> None:
    """Follow the ray from each point to an eye; points straight below it are never hidden."""
    for row in range(height.shape[0]):
        for column in range(height.shape[1]):
            across, along = x - column, y - row
            run = np.hypot(across, along)
            if run > 1.0 and height[row, column] < np.inf:
                rise = (up - height[row, column]) / run
                behind[row, column] = rise <= 0.0 or _met(
                    height, row, column, across / run, along / run, rise, top
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
