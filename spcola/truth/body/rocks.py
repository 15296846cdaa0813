"""Rocks below the smallest boulder of the catalogue: computed from an integer hash, not stored.

Each octave of diameters has its own cells on the cube around the body, so wide that a rock reaches
no further than into the next one; each cell has one rock or none. Its existence, place and shape
are hashed from the cell's number. The chance of one follows the power law by the area of the cell;
where it would exceed 1 (Weirich et al.'s rocks below 10 cm, around longitude 180°) some are
missing: one in seventy of that octave. The outermost cells of a face of the cube have no rock,
since it would be cut: a strip as wide as a few rocks, along the cube's edges, is empty.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spcola.arrays import AnyArray, FloatArray, IntArray
from spcola.compilation import compiled, compiled_inline
from spcola.truth.body.cells import face_directions, face_place, unwarp, warp_step
from spcola.truth.body.relief import BURIED, OUTLINE, PowerLaw, SmoothSite
from spcola.truth.body.roughness import mixed

_PATCHES = 128
_TURNS = 64
_SIZES = 256
_FACE = np.uint32(0x9E3779B1)
_ROW = np.uint32(0x85EBCA77)
_COLUMN = np.uint32(0xC2B2AE3D)
_SECOND = np.uint32(0x165667B1)
_S8 = np.uint32(8)
_S12 = np.uint32(12)
_S14 = np.uint32(14)
_S22 = np.uint32(22)
_SIX_BITS = np.uint32(63)
_EIGHT_BITS = np.uint32(255)
_TEN_BITS = np.uint32(1023)
_TWELVE_BITS = np.uint32(4095)


class Rocks(NamedTuple):
    """Parameters of the rocks for the kernels; lengths in metres.

    In octave k the largest diameter is ``largest[k]``, a face has ``cells[k]`` cells along its
    sides, and ``chance[k]`` is that of a rock in a cell where the `weight` is 1. `weight` (6, P, P)
    is the density by patches of the faces [face, t, s], as a factor of the mean one, times the area
    of the unit sphere per area of the face. `sizes` are spread evenly over the cumulative number of
    an octave (as factors of its smallest), `turns` (T, 2) over the directions.
    """

    radius: float
    seed: int
    largest: FloatArray
    cells: IntArray
    chance: FloatArray
    weight: FloatArray
    sizes: FloatArray
    turns: FloatArray


def make_rocks(
    law: PowerLaw, smallest: float | None, radius: float, seed: int, site: SmoothSite | None
) -> Rocks:
    """Return the rocks of `law` from its smallest diameter down by halves to `smallest`, metres.

    None for no rocks. There are fewer on the `site`, like boulders.
    """
    count = 0 if smallest is None else max(0, round(float(np.log2(law.smallest / smallest))))
    largest = law.smallest / 2.0 ** np.arange(count)
    # A cell is nowhere narrower than half of its width on the face, in metres, and no wider than
    # 2 radius / cells there.
    cells = np.maximum(3, np.floor(radius / largest)).astype(np.int64)
    per_m2 = law.density_per_km2 * 1e-6 * (0.5**-law.slope - 1.0) * largest**-law.slope
    chance = np.round(per_m2 * (2.0 * radius / cells) ** 2, 12)
    share = (np.arange(_SIZES) + 0.5) / _SIZES
    sizes = (1.0 - share * (1.0 - 0.5**law.slope)) ** (-1.0 / law.slope)
    angle = 2.0 * np.pi * np.arange(_TURNS) / _TURNS
    turns = np.column_stack([np.cos(angle), np.sin(angle)])
    return Rocks(
        radius, seed, largest, cells, chance, _weights(law, radius, site) if count else
        np.zeros((6, 1, 1)), np.round(sizes, 12), np.round(turns, 12),
    )  # fmt: skip


def _weights(law: PowerLaw, radius: float, site: SmoothSite | None) -> FloatArray:
    """Return the `weight` of :class:`Rocks`."""
    nodes = face_directions(np.linspace(-1.0, 1.0, _PATCHES + 1))
    one = nodes[:, 1:, 1:] - nodes[:, :-1, :-1]
    other = nodes[:, 1:, :-1] - nodes[:, :-1, 1:]
    across = np.cross(one, other)
    area = 0.5 * np.sqrt(np.sum(across**2, axis=-1)) * (_PATCHES / 2.0) ** 2
    middle = face_directions((np.arange(_PATCHES) + 0.5) * (2.0 / _PATCHES) - 1.0)
    weight: FloatArray = area * (1.0 - law.contrast * middle[..., 0])
    if site is not None:
        away = radius * np.sqrt(np.sum((middle - site.direction) ** 2, axis=-1))
        weight = np.where(away < site.radius_on(radius), site.share * weight, weight)
    return np.round(weight, 9)


@compiled
def rock_word(seed: int, octave: int, face: int, row: int, column: int) -> np.uint32:
    """Return the hash of a cell: the top 20 bits place its rock, the last 12 decide on one."""
    word = np.uint32(np.uint32(seed) + np.uint32(octave) * _SECOND)
    word = np.uint32(word + np.uint32(face + 1) * _FACE)
    word = np.uint32(word + np.uint32(row) * _ROW)
    return mixed(np.uint32(word + np.uint32(column) * _COLUMN))


@compiled
def rock_place(word: np.uint32) -> tuple[float, float]:
    """Return the place of a rock in its cell, along s and along t, in widths of the cell."""
    place = int(np.uint32(word >> _S12) & _TEN_BITS), int(np.uint32(word >> _S22) & _TEN_BITS)
    return (place[0] + 0.5) / 1024.0, (place[1] + 0.5) / 1024.0


@compiled
def rock_chance(weight: FloatArray, face: int, row: int, column: int, cells: int) -> float:
    """Return the `weight` of a cell; 0 in the outermost cells of a face."""
    if min(row, column) < 1 or max(row, column) > cells - 2:
        return 0.0
    patches = weight.shape[1]
    return weight[face, row * patches // cells, column * patches // cells]


@compiled
def has_rock(word: np.uint32, chance: float) -> bool:
    """Return whether there is a rock in a cell with the hash `word`."""
    return int(word & _TWELVE_BITS) < 4096.0 * chance


@compiled
def rock_diameter(word: np.uint32, least: float, sizes: FloatArray) -> float:
    """Return the diameter of a rock of an octave that begins at `least`, metres."""
    return least * sizes[int(mixed(np.uint32(word + _SECOND)) & _EIGHT_BITS)]


@compiled
def rock_shape(
    word: np.uint32, diameter: float, turns: FloatArray, place: tuple[float, float]
) -> float:
    """Return a rock's height (metres) above the ground at a `place` from its centre; 0 outside."""
    word = mixed(np.uint32(word + _SECOND))
    turn = int(np.uint32(word >> _S8) & _SIX_BITS)
    second = 0.6 + 0.4 / 255.0 * int(np.uint32(word >> _S14) & _EIGHT_BITS)
    third = 0.6 + 0.3 / 1023.0 * int(np.uint32(word >> _S22) & _TEN_BITS)
    c, s = turns[turn, 0], turns[turn, 1]
    semi = 0.5 * diameter / OUTLINE
    a = (c * place[0] + s * place[1]) / semi
    b = (c * place[1] - s * place[0]) / (semi * second)
    square = a * a + b * b
    if square >= OUTLINE * OUTLINE:
        return 0.0
    return max(0.0, semi * second * third * (np.sqrt(1.0 - square) - BURIED))


@compiled
def _metric(radius: float, s: float, t: float) -> tuple[float, float, float]:
    """Return metres along two perpendicular axes per step of s and t: xs, xt and yt (ys is 0).

    By Cholesky from the metric of the gnomonic projection.
    """
    u, v = unwarp(s), unwarp(t)
    w = 1.0 + u * u + v * v
    length = np.sqrt(1.0 + v * v) / w
    du, dv = radius * warp_step(u), radius * warp_step(v)
    return length * du, -u * v / (w * w * length) * dv, dv / (w * np.sqrt(w) * length)


@compiled_inline
def _octave_top(
    rocks: Rocks,
    octave: int,
    at: tuple[int, float, float],
    metric: tuple[float, float, float],
    least: float,
) -> float:
    """Return the height of a rock of an octave at (face, s, t), metres; 0 outside all.

    Rocks below the diameter `least` are ignored.
    """
    face, s, t = at
    cells, largest = rocks.cells[octave], rocks.largest[octave]
    x, y = (s + 1.0) * 0.5 * cells, (t + 1.0) * 0.5 * cells
    column, row = int(np.floor(x - 0.5)), int(np.floor(y - 0.5))
    step, top = 2.0 / cells, 0.0
    for corner in range(4):
        i, j = row + corner // 2, column + corner % 2
        word = rock_word(rocks.seed, octave, face, i, j)
        away = rock_place(word)
        ds, dt = (x - j - away[0]) * step, (y - i - away[1]) * step
        place = (metric[0] * ds + metric[1] * dt, metric[2] * dt)
        if place[0] * place[0] + place[1] * place[1] >= 0.25 * largest * largest:
            continue
        chance = rocks.chance[octave] * rock_chance(rocks.weight, face, i, j, cells)
        if has_rock(word, chance):
            diameter = rock_diameter(word, 0.5 * largest, rocks.sizes)
            if diameter >= least:
                top = max(top, rock_shape(word, diameter, rocks.turns, place))
    return top


@compiled
def raise_rocks(rocks: Rocks, directions: FloatArray, top: FloatArray, count: int) -> None:
    """Raise `top` to the rocks' heights in the first `count` unit directions (N, 3), metres."""
    for n in range(count):
        at = face_place(directions[n, 0], directions[n, 1], directions[n, 2])
        metric = _metric(rocks.radius, at[1], at[2])
        for octave in range(len(rocks.cells)):
            top[n] = max(top[n], _octave_top(rocks, octave, at, metric, 0.0))


@compiled
def flag_rocks(rocks: Rocks, directions: FloatArray, least: float, bit: int, out: AnyArray) -> None:
    """Set `bit` in `out` (N,) where a unit direction (N, 3) meets a rock of at least `least`."""
    for n in range(len(directions)):
        at = face_place(directions[n, 0], directions[n, 1], directions[n, 2])
        metric = _metric(rocks.radius, at[1], at[2])
        for octave in range(len(rocks.cells)):
            if _octave_top(rocks, octave, at, metric, least) > 0.0:
                out[n] |= bit
