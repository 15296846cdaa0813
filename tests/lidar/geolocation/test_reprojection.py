"""Scans located by another trajectory: they move as the spacecraft does."""

from __future__ import annotations

import numpy as np
import pytest

from lidar.geolocation import Unlocated, geolocated_by, scan_trajectory
from lidar.scans import Scan
from spcola.errors import InvalidValueError
from spcola.navigation import Trajectory

OFFSET = np.array([5.0, -3.0, 2.0])


def orbit(times: np.ndarray) -> np.ndarray:
    angle = 2 * np.pi * times / 15_000.0
    return 5000.0 * np.stack([np.cos(angle), np.sin(angle), 0.2 * np.sin(3 * angle)], axis=-1)


def scan(count: int = 2001, reference_offset: float = 1.1) -> Scan:
    rng = np.random.default_rng(1)
    time = np.linspace(100.0, 3900.0, count)
    spacecraft = orbit(time)
    points = rng.normal(0, 150.0, (count, 3))
    away = points - spacecraft
    distance = np.linalg.norm(away, axis=1)
    return Scan.of_points(
        "S1", points, time=time, spacecraft=spacecraft, range=distance - reference_offset
    )


def images(times: list[float]) -> Trajectory:
    stamps = np.array(times)
    ramp = OFFSET * (1 + stamps[:, None] / 4000.0)
    return Trajectory("spc", stamps, orbit(stamps) + ramp, np.full((len(stamps), 3), 0.5))


def expected(times: np.ndarray) -> np.ndarray:
    return OFFSET * (1 + times[:, None] / 4000.0)


def located(before: Scan, trajectory: Trajectory, max_gap_s: float = 4000.0) -> Scan:
    return geolocated_by(before, trajectory, max_gap_s=max_gap_s)[0]


def test_points_move_as_the_spacecraft_does_between_image_times() -> None:
    before = scan()
    after, offset = geolocated_by(before, images([500.0, 1700.0, 3200.0]), max_gap_s=2000.0)
    kept = (before.time >= 500.0) & (before.time <= 3200.0)
    moved = expected(after.time)
    np.testing.assert_allclose(after.points, before.points[kept] + moved, atol=1e-4)
    np.testing.assert_allclose(after.spacecraft, before.spacecraft[kept] + moved, atol=1e-4)
    np.testing.assert_allclose(after.beam, before.beam[kept], atol=1e-12)
    np.testing.assert_allclose(after.reference_offset, 1.1, atol=1e-9)
    np.testing.assert_array_equal(after.range, before.range[kept])
    np.testing.assert_allclose(offset.differences.position, expected(offset.differences.time))
    assert after.trajectory == "spc"


def test_returns_outside_the_images_are_rejected_and_counted() -> None:
    before = scan()
    after = located(before, images([500.0, 1700.0, 3200.0]), 2000.0)
    outside = int(np.sum((before.time < 500.0) | (before.time > 3200.0)))
    assert after.rejected == {Unlocated.OUTSIDE_TRAJECTORY: outside}
    assert len(after) + outside == len(before)


def test_long_gaps_are_rejected() -> None:
    before = scan()
    after = located(before, images([500.0, 1000.0, 3000.0, 3200.0]), 600.0)
    assert np.all((after.time <= 1000.0) | (after.time >= 3000.0))
    assert sum(after.rejected.values()) + len(after) == len(before)


def test_returns_without_a_time_are_counted_in_addition_to_earlier_rejections() -> None:
    whole = scan(50)
    time = whole.time.copy()
    time[:7] = np.nan
    spotty = Scan.of_points(
        "S2", whole.points, time=time, spacecraft=whole.spacecraft, range=whole.range,
        rejected={Unlocated.OUTSIDE_TRAJECTORY: 2, "noise": 3},
    )  # fmt: skip
    after = located(spotty, images([1000.0, 2000.0]))
    assert after.rejected["noise"] == 3
    assert after.rejected[Unlocated.NO_TIME] == 7
    assert after.rejected[Unlocated.OUTSIDE_TRAJECTORY] == 2 + 50 - 7 - len(after)


def test_the_reference_trajectory_gives_the_same_points_back() -> None:
    before = scan()
    after = located(before, scan_trajectory(before))
    np.testing.assert_allclose(after.points, before.points, atol=1e-9)
    assert len(after) == len(before)
    assert after.rejected == {}


def test_there_and_back() -> None:
    before = scan()
    there = located(before, images([100.0, 2000.0, 3900.0]))
    back = located(there, scan_trajectory(before))
    np.testing.assert_allclose(back.points, before.points, atol=1e-9)


def test_refuses_what_has_no_time_in_common_or_no_position() -> None:
    with pytest.raises(InvalidValueError, match="covers no time of 'spc'"):
        located(scan(), images([1e6, 2e6]))
    with pytest.raises(InvalidValueError, match="S0: has no time with a spacecraft position"):
        located(Scan.of_points("S0", np.zeros((3, 3))), images([0.0, 1.0]))
