"""The light map: the share of a rotation by formula on spheres, pits and mountains in shadow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from spcola.errors import SettingsError
from spcola.truth.sampled import LightMap, SampledSurface

RADIUS = 40.0
LIMIT = np.radians(80.0)


@dataclass(frozen=True)
class Radial:
    """A sphere with a relief over its unit directions."""

    relief: Callable[[np.ndarray], np.ndarray]

    def radius(self, directions: np.ndarray) -> np.ndarray:
        unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        return RADIUS + self.relief(unit)


def _flat(unit: np.ndarray) -> np.ndarray:
    return np.zeros(len(unit))


def _towards(longitude_deg: float, latitude_deg: float) -> np.ndarray:
    lon, lat = np.radians([longitude_deg, latitude_deg])
    return np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])


def _share_on_a_sphere(latitude: np.ndarray, sun_latitude: float, limit: float) -> np.ndarray:
    """Twice the hour angle at which the incidence reaches the limit, over a full turn."""
    cosine = np.cos(limit) - np.sin(latitude) * np.sin(sun_latitude)
    cosine = cosine / (np.cos(latitude) * np.cos(sun_latitude))
    return np.arccos(np.clip(cosine, -1.0, 1.0)) / np.pi


@pytest.mark.parametrize("sun_latitude_deg", [0.0, 2.0, -25.0])
def test_the_share_on_a_sphere_is_that_of_the_formula(sun_latitude_deg: float) -> None:
    sun_latitude = np.radians(sun_latitude_deg)
    surface = SampledSurface(Radial(_flat), 0.5)
    light = LightMap.of(surface, sun_latitude=sun_latitude, spacing=1.0, hours=180)
    directions = np.random.default_rng(3).normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    expected = _share_on_a_sphere(np.arcsin(directions[:, 2]), sun_latitude, LIMIT)
    found = light.at(directions)
    # One moment of 180 at either end of the day; more in the cells where a day comes to its end.
    error = np.abs(found - expected)
    assert error.mean() < 0.003
    assert np.mean(error > 2.0 / 180) < 0.02
    assert light.at(7.0 * directions[:5]) == pytest.approx(found[:5], abs=1e-12)


def test_a_low_sun_leaves_the_far_pole_dark() -> None:
    light = LightMap.of(SampledSurface(Radial(_flat), 1.0), sun_latitude=np.radians(10.0))
    assert light.at(np.array([[0.0, 0.0, -1.0]])) == 0.0
    high = LightMap.of(SampledSurface(Radial(_flat), 1.0), sun_latitude=np.radians(13.0))
    assert high.at(np.array([[0.0, 0.0, 1.0]])) == 1.0


def test_the_floor_of_a_pit_sees_the_sun_between_its_walls() -> None:
    radius, depth = 6.0, 6.0
    middle = _towards(0.0, 0.0)

    def pit(unit: np.ndarray) -> np.ndarray:
        away = RADIUS * np.linalg.norm(unit - middle, axis=1)
        return -depth * np.clip((radius + 0.5 - away) / 0.5, 0.0, 1.0)

    surface = SampledSurface(Radial(pit), 0.25)
    light = LightMap.of(surface, sun_latitude=0.0, spacing=1.0, hours=90)
    floor, rim = RADIUS - depth, np.sqrt(RADIUS**2 - (radius + 0.5) ** 2)
    expected = np.arctan2(radius + 0.5, rim - floor) / np.pi
    assert light.at(middle[None])[0] == pytest.approx(expected, abs=1.5 / 90)
    assert light.at(_towards(30.0, 0.0)[None])[0] == pytest.approx(4 / 9, abs=1.5 / 90)


def test_a_mountain_shades_the_ground_poleward_of_it_and_mirrors_with_the_sun() -> None:
    def mountain(north: bool) -> Radial:
        top = _towards(50.0, 70.0 if north else -70.0)
        return Radial(
            lambda unit: 6.0 * np.exp(-0.5 * (np.linalg.norm(unit - top, axis=1) / 0.07) ** 2)
        )

    maps = [
        LightMap.of(SampledSurface(mountain(north), 0.5), sun_latitude=sign * 0.05, spacing=1.0)
        for north, sign in ((True, 1), (False, -1))
    ]
    behind, off_side = _towards(50.0, 80.0)[None], _towards(230.0, 80.0)[None]
    assert maps[0].at(behind) < maps[0].at(off_side) - 0.1
    directions = np.random.default_rng(5).normal(size=(500, 3))
    north, south = maps[0].at(directions), maps[1].at(directions * [1, 1, -1])
    # What is symmetric in truth, rounding may decide otherwise at a shadow's edge.
    assert np.mean(np.abs(north - south) > 1e-6) < 0.02


@pytest.mark.parametrize(
    "wrong",
    [{"spacing": 0.0}, {"hours": 0}, {"sun_latitude": 2.0}, {"most_incidence": 2.0}],
)
def test_settings_out_of_range_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(SettingsError):
        LightMap.of(SampledSurface(Radial(_flat), 4.0), **{"sun_latitude": 0.0, **wrong})
