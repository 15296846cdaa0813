"""Craters and boulders of the synthetic body: catalogues drawn by power laws, and their shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from spcola.arrays import FloatArray, IntArray, read_only
from spcola.errors import SettingsError
from spcola.kernel import kernel
from spcola.truth.streams import stream

# A boulder is an ellipsoid of which the equator lies this share of its third semi-axis below the
# ground: sides then end at 61° at most, and the radius stays a function of direction.
BURIED = 0.4
CRATER_DEPTH = 0.12
"""Depth of a crater below the ground, in diameters."""
CRATER_RIM = 0.03
"""Height of its rim above the ground, in diameters."""
CRATER_REACH = 2.0
"""Distance at which the rim has come down to the ground, in crater radii."""


@dataclass(frozen=True)
class PowerLaw:
    """How many features there are: ``N(> D) = density · D ** -slope`` per square kilometre.

    Parameters
    ----------
    density_per_km2 : float
        Features larger than 1 m per square kilometre; 0 for none.
    slope : float
        Of the cumulative number.
    smallest, largest : float
        Diameters, metres.
    contrast : float
        The density goes as ``1 − contrast · x`` of the unit direction: least at longitude 0,
        greatest at 180° (Weirich et al., section 2), 0 for an even one.

    Raises
    ------
    SettingsError
        If a number lies outside its range.
    """

    density_per_km2: float
    slope: float
    smallest: float
    largest: float
    contrast: float = 0.5

    def __post_init__(self) -> None:
        if self.density_per_km2 < 0 or self.slope <= 0 or not 0 <= self.contrast <= 1:
            raise SettingsError("density, slope or contrast out of range", "power law")
        if not 0 < self.smallest < self.largest:
            raise SettingsError("diameters must be 0 < smallest < largest", "power law")

    def expected(self, area: float) -> float:
        """Mean number of features on `area`, square metres."""
        per_m2 = self.density_per_km2 * 1e-6
        return area * per_m2 * (self.smallest**-self.slope - self.largest**-self.slope)

    def draw(self, count: int, generator: np.random.Generator) -> FloatArray:
        """Draw `count` diameters, metres, largest first (inverse of the cumulative number)."""
        most, least = self.smallest**-self.slope, self.largest**-self.slope
        share = generator.random(count)
        diameters = (least + share * (most - least)) ** (-1.0 / self.slope)
        # Rounded: powers differ in the last bit from one machine's library to another's.
        return np.sort(np.round(diameters, 9))[::-1]


@dataclass(frozen=True, eq=False)
class Features:
    """Craters or boulders; N of them.

    Attributes
    ----------
    direction : (N, 3) ndarray
        Unit vectors to their centres.
    diameter : (N,) ndarray
        Metres (of a boulder: the longest axis).
    numbers : (N, K) ndarray
        What :func:`crater_height` or :func:`boulder_height` needs, one row for each.
    reach : (N,) ndarray
        Distance from the centre beyond which the feature adds nothing, metres.
    """

    direction: FloatArray
    diameter: FloatArray
    numbers: FloatArray
    reach: FloatArray

    def __len__(self) -> int:
        return len(self.diameter)


def directions(count: int, contrast: float, generator: np.random.Generator) -> FloatArray:
    """Draw unit vectors (count, 3) whose density goes as ``1 − contrast · x``."""
    kept = np.empty((0, 3))
    while len(kept) < count:
        trial = generator.normal(size=(2 * count + 8, 3))
        trial /= np.linalg.norm(trial, axis=1, keepdims=True)
        accept = generator.random(len(trial)) * (1.0 + contrast) < 1.0 - contrast * trial[:, 0]
        kept = np.concatenate([kept, trial[accept]])
    return kept[:count]


def draw_craters(law: PowerLaw, radius: float, seed: int) -> Features:
    """Draw the craters of a body of mean `radius`, metres."""
    generator = stream(seed, "craters")
    count = int(generator.poisson(law.expected(4.0 * np.pi * radius**2)))
    diameter = law.draw(count, generator)
    direction = directions(count, law.contrast, generator)
    freshness = generator.uniform(0.4, 1.0, size=count)
    numbers = np.column_stack(
        [
            direction,
            diameter / 2.0,
            CRATER_DEPTH * freshness * diameter,
            CRATER_RIM * freshness * diameter,
        ]
    )
    return Features(
        *(read_only(a) for a in (direction, diameter, numbers, CRATER_REACH * diameter / 2.0))
    )


def draw_boulders(law: PowerLaw, radius: float, seed: int) -> Features:
    """Draw the boulders of a body of mean `radius`, metres: ellipsoids, half buried."""
    generator = stream(seed, "boulders")
    count = int(generator.poisson(law.expected(4.0 * np.pi * radius**2)))
    diameter = law.draw(count, generator)
    direction = directions(count, law.contrast, generator)
    along = np.cross(direction, generator.normal(size=(count, 3)))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.cross(direction, along)
    semi = diameter / 2.0
    second = semi * generator.uniform(0.65, 1.0, size=count)
    third = second * generator.uniform(0.55, 0.8, size=count)
    numbers = np.column_stack(
        [direction, along / semi[:, None], across / second[:, None], third, BURIED * third]
    )
    return Features(*(read_only(a) for a in (direction, diameter, numbers, semi)))


@kernel
def crater_height(x: float, y: float, z: float, radius: float, crater: FloatArray) -> float:
    """Return what a crater adds to the radius in direction (x, y, z), metres.

    A parabolic bowl up to the rim, then a parabola down to the ground at twice the radius.
    Distances are chords at the body's mean `radius`.
    """
    dx, dy, dz = x - crater[0], y - crater[1], z - crater[2]
    square = (dx * dx + dy * dy + dz * dz) * (radius / crater[3]) ** 2
    if square < 1.0:
        return (crater[4] + crater[5]) * square - crater[4]
    if square < CRATER_REACH**2:
        fall = CRATER_REACH - np.sqrt(square)
        return crater[5] * fall * fall
    return 0.0


@kernel
def boulder_height(x: float, y: float, z: float, radius: float, boulder: FloatArray) -> float:
    """Return the height of a boulder above the ground in direction (x, y, z), 0 beside it."""
    a = radius * (x * boulder[3] + y * boulder[4] + z * boulder[5])
    b = radius * (x * boulder[6] + y * boulder[7] + z * boulder[8])
    square = a * a + b * b
    if square >= 1.0:
        return 0.0
    return max(0.0, boulder[9] * np.sqrt(1.0 - square) - boulder[10])


def cell_directions(cells: int) -> FloatArray:
    """Return unit vectors (6·cells², 3) to the centres of the cells of a cube seen from inside."""
    centre = (np.arange(cells) + 0.5) * (2.0 / cells) - 1.0
    v, u = np.meshgrid(centre, centre, indexing="ij")
    one = np.ones_like(u)
    faces = [(s * one, u, v) for s in (1, -1)]
    faces += [(u, s * one, v) for s in (1, -1)]
    faces += [(u, v, s * one) for s in (1, -1)]
    centres = np.concatenate([np.stack(face, axis=-1).reshape(-1, 3) for face in faces])
    return centres / np.linalg.norm(centres, axis=1, keepdims=True)


@kernel
def cell_of(x: float, y: float, z: float, cells: int) -> int:
    """Return the cell (as numbered by :func:`cell_directions`) that a direction falls in."""
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        face, u, v, w = 0 if x > 0 else 1, y, z, ax
    elif ay >= az:
        face, u, v, w = 2 if y > 0 else 3, x, z, ay
    else:
        face, u, v, w = 4 if z > 0 else 5, x, y, az
    column = min(cells - 1, int((u / w + 1.0) * 0.5 * cells))
    row = min(cells - 1, int((v / w + 1.0) * 0.5 * cells))
    return (face * cells + row) * cells + column


def index_features(features: Features, radius: float, cells: int) -> tuple[IntArray, IntArray]:
    """List for each cell the features that may reach into it.

    Returns
    -------
    start : (6·cells² + 1,) ndarray
        Where each cell's list begins in `items`.
    items : ndarray
        Numbers of features, ascending within a cell.
    """
    centres = cell_directions(cells)
    # No direction is further from the centre of its cell than half the diagonal of a cell on the
    # cube; chords grow by projection to the sphere from inside, never beyond that.
    margin = np.sqrt(2.0) / cells
    found = cKDTree(centres).query_ball_point(features.direction, features.reach / radius + margin)
    lengths = np.array([len(hits) for hits in found], dtype=np.int64)
    which = np.repeat(np.arange(len(features)), lengths)
    cell = np.array([c for hits in found for c in hits], dtype=np.int64)
    order = np.lexsort((which, cell))
    counts = np.bincount(cell, minlength=len(centres))
    start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return start, which[order].astype(np.int64)
