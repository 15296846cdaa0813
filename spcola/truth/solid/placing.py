"""Places and sizes of overhanging boulders and cliffs on a body."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from spcola.arrays import FloatArray
from spcola.truth.body import BodySettings, stream
from spcola.truth.body.relief import directions
from spcola.truth.solid.overhangs import (
    Cliff,
    Overhang,
    Patch,
    UndercutBoulder,
    ground_of_boulder,
    ground_of_cliff,
)
from spcola.truth.solid.refining import SmoothMesh
from spcola.truth.solid.settings import SolidSettings

_MOST_TRIALS = 400
# Sizes by this power law, as the other boulders.
_SLOPE = 2.7
# Circles of ground keep this share of their radius from each other.
_APART = 1.05
_BUMPS = 4


def place_overhangs(
    base: SmoothMesh, body: BodySettings, settings: SolidSettings
) -> tuple[Overhang, ...]:
    """Draw the overhanging features of a body, largest first; none overlaps another.

    The smooth site is left free. Features for which no place is left are left out.

    Parameters
    ----------
    base : SmoothMesh
        The smooth body, whose vertices are close to each other.
    body : BodySettings
    settings : SolidSettings
    """
    generator = stream(body.seed, "overhangs")
    tree = cKDTree(base.vertices)
    taken: list[tuple[FloatArray, float]] = []
    if body.site is not None:
        site = body.radius * body.site.direction
        taken.append((base.vertices[tree.query(site)[1]], body.site.radius_on(body.radius)))

    def patch(reach: float) -> Patch | None:
        for trial in directions(_MOST_TRIALS, 0.0, generator):
            number = tree.query(body.radius * trial)[1]
            place = base.vertices[number]
            away = [np.sqrt(np.sum((place - other) ** 2)) for other, _ in taken]
            if all(d > _APART * (reach + r) for d, (_, r) in zip(away, taken, strict=True)):
                taken.append((place, reach))
                return Patch(place, _axes(base.normals[number], generator), reach)
        return None

    length, height = settings.cliff_length, settings.cliff_height
    found: list[Overhang] = []
    for _ in range(settings.cliffs):
        ground = patch(ground_of_cliff(length, height, settings.cliff_overhang))
        if ground is not None:
            found.append(Cliff(ground, length, height, settings.cliff_overhang))
    # Rounded: tangents and roots differ in the last bit between the libraries of machines. The
    # cubes of the bumps are added.
    tangent = float(np.round(np.tan(np.radians(settings.reach_deg) / 4.0), 12))
    strength = float(np.round(np.cbrt(0.5 * settings.roughness), 9))
    for semi_axes in _sizes(settings, generator):
        ground = patch(ground_of_boulder(semi_axes))
        bumps = strength * directions(_BUMPS, 0.0, generator)
        if ground is not None:
            found.append(UndercutBoulder(ground, semi_axes, tangent, bumps))
    return tuple(found)


def _sizes(
    settings: SolidSettings, generator: np.random.Generator
) -> list[tuple[float, float, float]]:
    """Return the semi-axes of the boulders, largest first, metres."""
    most, least = settings.smallest**-_SLOPE, settings.largest**-_SLOPE
    share = generator.random(settings.boulders)
    # Rounded: powers differ in the last bit between the libraries of machines.
    longest = np.round((least + share * (most - least)) ** (-1.0 / _SLOPE), 9)
    second = generator.uniform(0.7, 1.0, size=settings.boulders)
    third = generator.uniform(0.7, 0.95, size=settings.boulders)
    sizes = 0.5 * np.sort(longest)[::-1]
    return [
        (float(a), float(a * b), float(a * b * c))
        for a, b, c in zip(sizes, second, third, strict=True)
    ]


def _axes(normal: FloatArray, generator: np.random.Generator) -> FloatArray:
    """Return axes (3, 3) with that normal, turned at random about it."""
    aside = directions(1, 0.0, generator)[0]
    along = aside - (aside @ normal) * normal
    if along @ along < 1e-6:
        along = np.array([normal[1], normal[2], normal[0]]) - normal * (
            normal[1] * normal[0] + normal[2] * normal[1] + normal[0] * normal[2]
        )
    along = along / np.sqrt(np.sum(along**2))
    return np.stack([along, np.cross(normal, along), normal])
