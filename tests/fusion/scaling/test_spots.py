from __future__ import annotations

import numpy as np
import pytest

from fusion.scaling.shots import SpotOptions, compare_shots
from fusion.scaling.shots.spots import cast_spots
from lidar.scans import Scan
from spcola.errors import InvalidValueError
from spcola.shape import Mesh, RayCaster


def ground(height, side=60.0, count=121):
    """A mesh over a square, heights along Z."""
    line = np.linspace(-side, side, count)
    x, y = np.meshgrid(line, line)
    vertices = np.stack([x, y, height(x, y)], axis=2).reshape(-1, 3)
    corner = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    lower = np.stack([corner, corner + 1, corner + count + 1], axis=1)
    upper = np.stack([corner, corner + count + 1, corner + count], axis=1)
    return Mesh(vertices, np.concatenate([lower, upper]))


def rough(x, y):
    """Hills of metres on the scale of a pointing error."""
    return 1.2 * np.sin(x / 1.9 + 0.3 * y) * np.cos(y / 2.3) + 0.8 * np.sin(y / 3.1 - x / 5.0)


STATION = np.array([[0.0, 0.0, 5000.0]])
DOWN = np.array([[0.0, 0.0, -1.0]])


def test_on_a_slope_the_variance_is_that_of_the_partials():
    caster = RayCaster(ground(lambda x, y: 0.3 * x))
    spots = cast_spots(caster, STATION, DOWN, SpotOptions(pointing_sigma_rad=2e-4))
    # One metre on the ground, 0.3 of it in range.
    np.testing.assert_allclose(np.sqrt(spots.variance), 0.3, rtol=2e-3)
    np.testing.assert_allclose(spots.distance, 5000.0)


def test_a_footprint_takes_the_mean_and_calls_no_slope_rough():
    slope = RayCaster(ground(lambda x, y: 0.3 * x))
    spots = cast_spots(slope, STATION, DOWN, SpotOptions(footprint_rad=2e-3))
    np.testing.assert_allclose(spots.distance, 5000.0, atol=0.005)
    assert np.sqrt(spots.variance[0]) < 0.005
    # A bowl of curvature c: over a disc of radius 5 m the mean of c r²/2 is c 25/4.
    bowl = RayCaster(ground(lambda x, y: 0.02 * (x**2 + y**2) / 2.0))
    seen = cast_spots(bowl, STATION, DOWN, SpotOptions(footprint_rad=2e-3))
    np.testing.assert_allclose(seen.distance, 5000.0 - 0.02 * 25.0 / 4.0, atol=0.01)
    assert 0.01 < np.sqrt(seen.variance[0]) < 0.2


def test_without_footprint_and_pointing_it_is_the_axis_alone():
    caster = RayCaster(ground(rough))
    spots = cast_spots(caster, STATION, DOWN, SpotOptions())
    np.testing.assert_array_equal(spots.distance, caster.cast(STATION, DOWN).distance)
    assert spots.variance[0] == 0.0


def test_pulls_are_of_unit_width_where_pointing_errs_on_rough_ground():
    generator = np.random.default_rng(5)
    caster, count, sigma = RayCaster(ground(rough)), 3000, 1.5e-4
    aim = np.zeros((count, 3))
    aim[:, :2] = generator.uniform(-45.0, 45.0, (count, 2))
    stated = aim - STATION
    stated /= np.linalg.norm(stated, axis=1, keepdims=True)
    true = stated + sigma * np.c_[generator.normal(size=(count, 2)), np.zeros(count)]
    true /= np.linalg.norm(true, axis=1, keepdims=True)
    measured = caster.cast(STATION[0], true).distance + 0.1 * generator.normal(size=count)
    spacecraft = np.repeat(STATION, count, axis=0)
    scan = Scan.of_points("S", spacecraft + measured[:, None] * stated, spacecraft=spacecraft)
    found = compare_shots(scan, caster, spots=SpotOptions(pointing_sigma_rad=sigma)).observations
    pulls = found.value[:, 0] / np.sqrt(found.covariance[:, 0, 0])
    assert found.value.std() > 3 * 0.1
    assert 0.95 < pulls.std() < 1.05
    unaware = compare_shots(scan, caster).observations
    assert (unaware.value[:, 0] / np.sqrt(unaware.covariance[:, 0, 0])).std() > 3.0


def test_a_negative_footprint_is_refused():
    with pytest.raises(InvalidValueError, match="negative"):
        SpotOptions(footprint_rad=-1e-3)
