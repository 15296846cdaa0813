"""Returns located again: by the formula, there and back, and not where nothing is known."""

from __future__ import annotations

import numpy as np
import pytest

from lidar.geolocation import Geolocation, find_geolocation
from lidar.scans.cubes import QUANTUM_M
from spcola.errors import InvalidValueError
from spcola.navigation import Spin, Trajectory

STATED = Spin(85.45218, -60.36780, 140.68800, 2011.14558095)
CORRECTED = Spin(85.46, -60.36, 140.70, 2011.1456)
START = 6.2e8


def path(time: np.ndarray) -> np.ndarray:
    angle = 2 * np.pi * (time - START) / 15_000.0
    radius = 950.0 + 0.05 * (time - START)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0.1 * (time - START)])


@pytest.fixture
def scan() -> tuple[np.ndarray, np.ndarray, Trajectory]:
    """Points, their times in no order, and the trajectory that located them."""
    rng = np.random.default_rng(1)
    points = rng.normal(size=(4000, 3))
    points *= 250.0 / np.linalg.norm(points, axis=1, keepdims=True)
    knots = START + np.linspace(0.0, 320.0, 60)
    return points, START + rng.uniform(0.0, 320.0, 4000), Trajectory("old", knots, path(knots))


def test_a_corrected_rotation_turns_every_return_by_its_time(scan) -> None:
    points, time, old = scan
    moved, kept = find_geolocation(old, 250.0, spin=(STATED, CORRECTED)).apply(points, time)
    assert kept.all()
    expected = STATED.moved(points, CORRECTED, time)
    assert np.abs(expected - points).max() > 0.05
    assert np.abs(moved - expected).max() < QUANTUM_M / 5


def test_a_body_that_turns_in_minutes_is_followed(scan) -> None:
    points, time, old = scan
    fast, other = Spin(10.0, 20.0, 0.0, 360.0 * 200), Spin(10.5, 20.0, 0.0, 360.0 * 200)
    moved, _ = find_geolocation(old, 250.0, spin=(fast, other)).apply(points, time)
    expected = fast.moved(points, other, time)
    assert np.abs(moved - expected).max() < QUANTUM_M / 5


def test_there_and_back_is_the_first_place(scan) -> None:
    points, time, old = scan
    there, _ = find_geolocation(old, 250.0, spin=(STATED, CORRECTED)).apply(points, time)
    back, _ = find_geolocation(old, 250.0, spin=(CORRECTED, STATED)).apply(there, time)
    assert np.abs(back - points).max() < QUANTUM_M / 5


def test_another_trajectory_moves_returns_as_the_spacecraft(scan) -> None:
    points, time, old = scan
    states = START + np.array([0.0, 100.0, 210.0, 320.0])
    new = Trajectory("spc", states, path(states) + np.array([1.0, -2.0, 0.5]))
    moved, kept = find_geolocation(old, 250.0, trajectory=new).apply(points, time)
    assert kept.all()
    # The old trajectory between its knots is a spline's.
    np.testing.assert_allclose(moved - points, [[1.0, -2.0, 0.5]] * 4000, atol=1e-6)


def test_trajectory_and_rotation_together_are_the_ray_from_the_new_station(scan) -> None:
    points, time, old = scan
    states = START + np.linspace(0.0, 320.0, 33)
    rng = np.random.default_rng(3)
    right = STATED.moved(old.at(states), CORRECTED, states)
    new = Trajectory("spc", states, right + 0.2 * rng.normal(size=(33, 3)))
    moved, _ = find_geolocation(old, 250.0, spin=(STATED, CORRECTED), trajectory=new).apply(
        points, time
    )
    beam = STATED.moved(points - old.at(time), CORRECTED, time)
    station = moved - beam
    # At the states themselves the station is the new one; between them in straight lines.
    there = STATED.moved(old.at(time), CORRECTED, time) + np.column_stack(
        [np.interp(time, states, (new.position - right)[:, axis]) for axis in range(3)]
    )
    assert np.abs(station - there).max() < 1e-5


def test_times_that_are_not_covered_get_no_place(scan) -> None:
    points, time, old = scan
    states = START + np.array([50.0, 60.0, 200.0, 250.0])
    new = Trajectory("spc", states, path(states) + 1.0)
    moved, kept = find_geolocation(old, 250.0, trajectory=new, max_gap_s=60.0).apply(points, time)
    since = time - START
    covered = ((since >= 50) & (since <= 60)) | ((since >= 200) & (since <= 250))
    np.testing.assert_array_equal(kept, covered)
    assert np.isnan(moved[~covered]).all()
    unknown = np.full(len(time), np.nan)
    assert (
        not find_geolocation(old, 250.0, spin=(STATED, CORRECTED)).apply(points, unknown)[1].any()
    )


def test_a_single_state_places_the_shot_at_its_time_only(scan) -> None:
    points, time, old = scan
    new = Trajectory("spc", time[:1], old.at(time[:1]) + 2.0)
    moved, kept = find_geolocation(old, 250.0, trajectory=new).apply(points, time)
    assert kept.tolist() == [True] + [False] * 3999
    np.testing.assert_allclose(moved[0], points[0] + 2.0, atol=1e-9)


def test_reach_bounds_how_far_returns_move(scan) -> None:
    points, time, old = scan
    states = START + np.linspace(0.0, 320.0, 9)
    new = Trajectory("spc", states, path(states) + np.array([3.0, 0.0, -4.0]))
    change = find_geolocation(old, 250.0, spin=(STATED, CORRECTED), trajectory=new)
    moved, _ = change.apply(points, time)
    away = np.linalg.norm(moved - points, axis=1).max()
    assert away <= change.reach(250.0) < 1.3 * away
    assert Geolocation().reach(250.0) == 0.0


def test_trajectories_without_a_time_in_common_are_refused(scan) -> None:
    _, _, old = scan
    later = Trajectory("later", START + np.array([1e5, 2e5]), np.ones((2, 3)))
    with pytest.raises(InvalidValueError, match="covers no time"):
        find_geolocation(old, 250.0, trajectory=later)
    with pytest.raises(InvalidValueError, match="covers no time"):
        find_geolocation(old, 250.0, trajectory=later, spin=(STATED, CORRECTED))
