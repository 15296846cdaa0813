"""Craters, boulders and spots of the synthetic body: random catalogues, and their shapes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray, read_only
from spcola.compilation import compiled
from spcola.errors import SettingsError
from spcola.truth.body.streams import stream

# A boulder is an ellipsoid whose equator lies this share of its third semi-axis below the ground:
# its sides end at 64° at most, and the radius remains a function of direction.
BURIED = 0.4
OUTLINE = float(np.sqrt(1.0 - BURIED**2))
"""Size of a boulder's outline, where it meets the ground, relative to the whole ellipsoid."""
BOULDER_SLOPE = 2.1
"""Tangent of the steepest side of a boulder."""
BOULDER_HEIGHT = 0.3
"""Largest height of a boulder above the ground, in diameters."""
CRATER_DEPTH = 0.14
"""Depth of a crater below the ground, in diameters."""
CRATER_RIM = 0.03
"""Height of its rim above the ground, in diameters."""
CRATER_REACH = 2.0
"""Distance at which the rim has fallen to the ground, in crater radii."""
# Largest feature on the smooth site, as a share of its diameter.
_LARGEST_ON_SITE = 0.05


@dataclass(frozen=True)
class PowerLaw:
    """Numbers of features: ``N(> D) = density · D ** -slope`` per square kilometre.

    Parameters
    ----------
    density_per_km2 : float
        Features larger than 1 m per square kilometre; 0 for none.
    slope : float
        Exponent of the cumulative number.
    smallest, largest : float
        Diameters, metres.
    contrast : float
        The density is ``1 − contrast · x`` of the unit direction: sinusoidal in longitude, least
        at 0, greatest at 180° (Weirich et al., section 2.4); 0 for a uniform one.

    Raises
    ------
    SettingsError
        If a number lies outside its range.
    """

    density_per_km2: float
    slope: float
    smallest: float
    largest: float
    contrast: float = 0.8

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
        # Rounded: powers differ in the last bit between the libraries of machines.
        return np.sort(np.round(diameters, 9))[::-1]


@dataclass(frozen=True)
class SmoothSite:
    """A smooth area with few craters and boulders, as for a landing.

    Parameters
    ----------
    diameter : float
        Metres; at most 50/245 of the body's radius, so that small bodies have one too.
    latitude_deg, longitude_deg : float
        Position of its middle.
    share : float
        Remaining share of the roughness at wavelengths below its diameter, and of the number of
        craters and boulders.

    Raises
    ------
    SettingsError
        If a number lies outside its range.
    """

    diameter: float = 50.0
    latitude_deg: float = -10.0
    longitude_deg: float = 350.0
    share: float = 0.12

    def __post_init__(self) -> None:
        if not (self.diameter > 0 and 0 <= self.share <= 1 and abs(self.latitude_deg) <= 90):
            raise SettingsError("diameter, share or latitude out of range", "site")

    @property
    def direction(self) -> FloatArray:
        """Unit vector (3,) to its middle."""
        latitude, longitude = np.radians([self.latitude_deg, self.longitude_deg])
        x, y = np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude)
        # Rounded: sines differ in the last bit between the libraries of machines.
        return np.round(np.array([x, y, np.sin(latitude)]), 12)

    def radius_on(self, body_radius: float) -> float:
        """Return its radius on a body of `body_radius`, metres."""
        return 0.5 * min(self.diameter, body_radius * 50.0 / 245.0)


@dataclass(frozen=True, eq=False)
class Features:
    """Craters, boulders or spots; N of them, largest first.

    Attributes
    ----------
    direction : (N, 3) ndarray
        Unit vectors to their centres.
    diameter : (N,) ndarray
        Metres (of a boulder: the longest axis of its outline).
    numbers : (N, K) ndarray
        Parameters of :func:`crater_height`, :func:`boulder_height` or :func:`spot_albedo`, one
        row for each.
    reach : (N,) ndarray
        Distance from the centre beyond which the feature adds nothing, metres.
    """

    direction: FloatArray
    diameter: FloatArray
    numbers: FloatArray
    reach: FloatArray

    def __len__(self) -> int:
        return len(self.diameter)

    def without(self, dropped: FloatArray) -> Features:
        """Return the features where `dropped` (N,) is False."""
        kept = ~np.asarray(dropped, dtype=bool)
        arrays = (self.direction, self.diameter, self.numbers, self.reach)
        return Features(*(read_only(array[kept]) for array in arrays))


def directions(count: int, contrast: float, generator: np.random.Generator) -> FloatArray:
    """Draw unit vectors (count, 3) with a density of ``1 − contrast · x``.

    By rejection from a cube: only sums, products and roots, which are equal on every machine.
    """
    kept = np.empty((0, 3))
    while len(kept) < count:
        trial = generator.uniform(-1.0, 1.0, size=(4 * count + 8, 3))
        square = trial[:, 0] ** 2 + trial[:, 1] ** 2 + trial[:, 2] ** 2
        inside = (square > 0.01) & (square <= 1.0)
        trial = trial[inside] / np.sqrt(square[inside])[:, None]
        accept = generator.random(len(trial)) * (1.0 + contrast) < 1.0 - contrast * trial[:, 0]
        kept = np.concatenate([kept, trial[accept]])
    return kept[:count]


def on_site(
    features: Features, site: SmoothSite | None, radius: float, generator: np.random.Generator
) -> FloatArray:
    """Return which features (N,) are missing on the smooth `site` of a body of mean `radius`."""
    chance = generator.random(len(features))
    if site is None:
        return np.zeros(len(features))
    away = radius * np.sqrt(np.sum((features.direction - site.direction) ** 2, axis=1))
    touching = away < site.radius_on(radius) + features.diameter / 2.0
    large = features.diameter > 2.0 * _LARGEST_ON_SITE * site.radius_on(radius)
    return touching & (large | (chance >= site.share))


def draw_craters(
    law: PowerLaw, radius: float, seed: int, site: SmoothSite | None = None
) -> Features:
    """Draw the craters of a body of mean `radius`, metres."""
    generator = stream(seed, "craters")
    count = int(generator.poisson(law.expected(4.0 * np.pi * radius**2)))
    diameter = law.draw(count, generator)
    direction = directions(count, law.contrast, generator)
    freshness = generator.uniform(0.4, 1.0, size=count)
    deep, high = CRATER_DEPTH * freshness * diameter, CRATER_RIM * freshness * diameter
    numbers = np.column_stack([direction, diameter / 2.0, deep, high])
    drawn = Features(direction, diameter, numbers, CRATER_REACH * diameter / 2.0)
    return drawn.without(on_site(drawn, site, radius, generator))


def draw_boulders(
    law: PowerLaw, radius: float, seed: int, site: SmoothSite | None = None
) -> Features:
    """Draw the boulders of a body of mean `radius`, metres: ellipsoids, half buried."""
    generator = stream(seed, "boulders")
    count = int(generator.poisson(law.expected(4.0 * np.pi * radius**2)))
    diameter = law.draw(count, generator)
    direction = directions(count, law.contrast, generator)
    along = np.cross(direction, directions(count, 0.0, generator))
    along /= np.sqrt(np.sum(along**2, axis=1))[:, None]
    across = np.cross(direction, along)
    semi = diameter / 2.0 / OUTLINE
    second = semi * generator.uniform(0.6, 1.0, size=count)
    third = second * generator.uniform(0.6, 0.9, size=count)
    numbers = np.column_stack(
        [direction, along / semi[:, None], across / second[:, None], third, BURIED * third]
    )
    drawn = Features(direction, diameter, numbers, diameter / 2.0)
    return drawn.without(on_site(drawn, site, radius, generator))


def draw_spots(law: PowerLaw, radius: float, seed: int, extremes: tuple[float, float]) -> Features:
    """Draw the spots of a body of mean `radius`, metres, half of them bright and half dark.

    Their contributions to the relative albedo reach up (and down) to the `extremes`.
    """
    generator = stream(seed, "spots")
    count = int(generator.poisson(law.expected(4.0 * np.pi * radius**2)))
    diameter = law.draw(count, generator)
    direction = directions(count, law.contrast, generator)
    most = np.where(generator.random(count) < 0.5, *extremes)
    added = most * generator.uniform(0.4, 1.0, size=count)
    numbers = np.column_stack([direction, diameter / 2.0, added])
    return Features(direction, diameter, numbers, diameter / 2.0)


@compiled
def from_centre(x: float, y: float, z: float, radius: float, feature: FloatArray) -> float:
    """Return the square of the distance from a feature's centre, in its radii.

    Distances are chords at the body's mean `radius`; the first numbers of the feature are its
    direction and its radius.
    """
    dx, dy, dz = x - feature[0], y - feature[1], z - feature[2]
    scale = radius / feature[3]
    return (dx * dx + dy * dy + dz * dz) * (scale * scale)


@compiled
def crater_height(x: float, y: float, z: float, radius: float, crater: FloatArray) -> float:
    """Return the height of a crater in direction (x, y, z), metres (added to the radius).

    A bowl ``−depth (1 − q)²`` up to the rim, q the squared distance in crater radii, and a round
    rim on it that has fallen to the ground at twice the radius.
    """
    square = from_centre(x, y, z, radius, crater)
    if square < 1.0:
        flat = 1.0 - square
        return crater[5] * square * square * (1.0 + 2.0 * flat) - crater[4] * flat * flat
    if square < CRATER_REACH**2:
        fall = (CRATER_REACH - np.sqrt(square)) / (CRATER_REACH - 1.0)
        return crater[5] * fall * fall * (3.0 - 2.0 * fall)
    return 0.0


@compiled
def boulder_square(x: float, y: float, z: float, radius: float, boulder: FloatArray) -> float:
    """Return the squared distance from a boulder's axis, 1 at the ellipsoid's (buried) equator."""
    a = radius * (x * boulder[3] + y * boulder[4] + z * boulder[5])
    b = radius * (x * boulder[6] + y * boulder[7] + z * boulder[8])
    return a * a + b * b


@compiled
def boulder_height(x: float, y: float, z: float, radius: float, boulder: FloatArray) -> float:
    """Return the height of a boulder above the ground in direction (x, y, z), 0 outside it."""
    square = boulder_square(x, y, z, radius, boulder)
    if square >= OUTLINE * OUTLINE:
        return 0.0
    return max(0.0, boulder[9] * np.sqrt(1.0 - square) - boulder[10])


@compiled
def spot_albedo(x: float, y: float, z: float, radius: float, spot: FloatArray) -> float:
    """Return the relative albedo that a spot adds in direction (x, y, z)."""
    square = from_centre(x, y, z, radius, spot)
    if square >= 1.0:
        return 0.0
    return spot[4] * (1.0 - square * square)
