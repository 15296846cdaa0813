"""Upper bounds of the relief near a direction, over which rays skip without evaluating it.

A cube around the body is divided into cells. For each cell, and for neighbourhoods of it that grow
by factors of two, the table has a height above the smooth shape that nothing exceeds there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from spcola.arrays import FloatArray, IntArray
from spcola.compilation import compiled
from spcola.truth.body.cells import Indexed, cell_of, face_directions, index_features
from spcola.truth.body.relief import BOULDER_HEIGHT, Features
from spcola.truth.body.surface import Surface, low_degree

_CELL_WIDTH = 4.0
_FEWEST, _MOST = 16, 128
_SAMPLES = 4
_LEVELS = 6
# Between samples the ground (without boulders) rises by no more than this times the distance.
_GROUND_SLOPE = 1.0
# Cells next to the corners of the cube are rhombs of 60°.
_INNER_WIDTH = 0.8
_MARGIN = 1.1


class Bounds(NamedTuple):
    """Upper bounds of the relief; lengths in metres.

    ``tops[cell, level]`` is the height above the smooth shape under which everything lies within
    ``reach[level]`` of a cell. `slope` is the steepest slope of the smooth shape, `leap` a length
    within which crossings are ignored; nothing is further from O than `ceiling`. The `radius` and
    the `shape` are copies of the surface's, so that kernels need no other argument.
    """

    radius: float
    shape: FloatArray

    cells: int
    tops: FloatArray
    reach: FloatArray
    slope: float
    leap: float
    ceiling: float


@compiled
def _heights_above(surface: Surface, directions: FloatArray, radius: FloatArray) -> None:
    """Subtract the smooth shape from each `radius` (N,) in the unit `directions` (N, 3)."""
    for i in range(len(radius)):
        d = directions[i]
        radius[i] -= surface.radius * low_degree(surface.shape, d[0], d[1], d[2])


@compiled
def _steepest(surface: Surface, directions: FloatArray) -> float:
    """Return the steepest change of the smooth shape between successive directions (N, 3).

    As a factor of the mean radius, per chord of the unit sphere.
    """
    most = 0.0
    for i in range(len(directions) - 1):
        a, b = directions[i], directions[i + 1]
        chord = np.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)
        if 0.0 < chord < 0.2:
            one = low_degree(surface.shape, a[0], a[1], a[2])
            most = max(most, abs(low_degree(surface.shape, b[0], b[1], b[2]) - one) / chord)
    return most


@compiled
def _spread_tops(tops: FloatArray, corners: IntArray, at_corner: FloatArray) -> None:
    """Raise each of `tops` (C,) to the highest of the cells that share one of its corners."""
    at_corner[:] = -np.inf
    for cell in range(len(tops)):
        for corner in corners[cell]:
            at_corner[corner] = max(at_corner[corner], tops[cell])
    for cell in range(len(tops)):
        for corner in corners[cell]:
            tops[cell] = max(tops[cell], at_corner[corner])


def cell_corners(cells: int) -> tuple[IntArray, float]:
    """Return the numbers (6·cells², 4) of each cell's corners, and the least width of a cell.

    Corners on an edge of the cube have one number on both faces. The width is a chord of the unit
    sphere.
    """
    nodes = face_directions(np.linspace(-1.0, 1.0, cells + 1))
    keys = np.round(nodes * 1e6).astype(np.int64) + 2**20
    packed = (keys[..., 0] * 2**21 + keys[..., 1]) * 2**21 + keys[..., 2]
    numbers = np.unique(packed, return_inverse=True)[1].reshape(6, cells + 1, cells + 1)
    around = [numbers[:, :-1, :-1], numbers[:, :-1, 1:], numbers[:, 1:, :-1], numbers[:, 1:, 1:]]
    sides = [np.linalg.norm(np.diff(nodes, axis=axis), axis=-1).min() for axis in (1, 2)]
    return np.stack(around, axis=-1).reshape(-1, 4), _INNER_WIDTH * float(min(sides))


def make_bounds(
    surface: Surface,
    boulders: Features,
    radii_of: Callable[[Surface, FloatArray], FloatArray],
    leap: float,
) -> Bounds:
    """Make the table of a `surface` with these `boulders`.

    `radii_of` returns radii (N,) of a surface in unit directions (N, 3); `leap` is in metres.
    """
    count = int(np.clip(np.ceil(np.pi * surface.radius / 2.0 / _CELL_WIDTH), _FEWEST, _MOST))
    fine = count * _SAMPLES
    samples = face_directions((np.arange(fine) + 0.5) * (2.0 / fine) - 1.0)
    flat = samples.reshape(-1, 3)
    ground = radii_of(_bare(surface), flat)
    rock = BOULDER_HEIGHT * float(surface.rocks.largest.max(initial=0.0))
    spacing = 1.5 * surface.radius / fine
    margin = _GROUND_SLOPE * spacing * np.sqrt(0.5)
    lowest, highest = float(ground.min()) - margin, float(ground.max()) + margin
    _heights_above(surface, flat, ground)
    blocks = ground.reshape(6, count, _SAMPLES, count, _SAMPLES)
    stand = boulders.numbers[:, 9] - boulders.numbers[:, 10]
    on_it = np.maximum(_tallest(boulders, stand, surface, count), rock)
    tops = blocks.max(axis=(2, 4)).ravel() + margin + on_it
    slope = _MARGIN * _steepest(surface, flat) * surface.radius / lowest
    corners, width = cell_corners(count)
    levels, at_corner = [], np.empty(int(corners.max()) + 1)
    for level in range(_LEVELS):
        for _ in range(1 if level == 0 else 2 ** (level - 1)):
            _spread_tops(tops, corners, at_corner)
        levels.append(tops.copy())
    reach = width * lowest * 2.0 ** np.arange(_LEVELS)
    ceiling = highest + float(stand.max(initial=rock))
    tables = (count, np.stack(levels, axis=1), reach, slope, leap, ceiling)
    return Bounds(surface.radius, surface.shape, *tables)


def _tallest(boulders: Features, stand: FloatArray, surface: Surface, cells: int) -> FloatArray:
    """Return the height (6·cells²,) of the tallest boulder that reaches into each cell."""
    chords = boulders.reach / surface.radius
    index = index_features(boulders.numbers, boulders.direction, chords, cells)
    tallest = np.zeros(6 * cells**2)
    where = np.repeat(np.arange(len(tallest)), np.diff(index.start))
    np.maximum.at(tallest, where, stand[index.items])
    return tallest


def _bare(surface: Surface) -> Surface:
    """Return the `surface` without its boulders and rocks."""
    index, rocks = surface.boulders, surface.rocks
    none = Indexed(index.numbers, 1, np.zeros(7, np.int64), index.items[:0])
    return surface._replace(boulders=none, rocks=rocks._replace(cells=rocks.cells[:0]))


@compiled
def fly(
    bounds: Bounds,
    feet: FloatArray,
    beams: FloatArray,
    i: int,
    span: tuple[float, float],
) -> float:
    """Return the distance that ray `i` can safely advance from ``span[0]``, up to ``span[1]``.

    Over a distance d the ray descends by at most d cos θ, with θ from the vertical at its
    beginning; and the smooth shape rises by at most its slope times d sin θ.
    """
    t, end = span
    while t < end:
        x = feet[i, 0] + t * beams[i, 0]
        y = feet[i, 1] + t * beams[i, 1]
        z = feet[i, 2] + t * beams[i, 2]
        length = np.sqrt(x * x + y * y + z * z)
        cosine = -(x * beams[i, 0] + y * beams[i, 1] + z * beams[i, 2]) / length
        x, y, z = x / length, y / length, z / length
        sine = np.sqrt(max(0.0, 1.0 - cosine * cosine))
        rate = max(cosine + bounds.slope * sine, 0.02)
        height = length - bounds.radius * low_degree(bounds.shape, x, y, z)
        cell = cell_of(x, y, z, bounds.cells)
        step = 0.0
        for level in range(len(bounds.reach)):
            gap = height - bounds.tops[cell, level]
            if gap > 0.0:
                step = max(step, min(bounds.reach[level], gap / rate))
        if step < 0.05:
            break
        t += step
    return t
