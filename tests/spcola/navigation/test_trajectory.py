from __future__ import annotations

import numpy as np
import pytest

from spcola.camera import Camera, SpcImage
from spcola.errors import InvalidValueError
from spcola.navigation import Trajectory, et_from_utc

TIMES = np.linspace(0.0, 4000.0, 41)


def circle(times: np.ndarray) -> np.ndarray:
    angle = 2 * np.pi * times / 15_000.0
    return 5000.0 * np.stack([np.cos(angle), np.sin(angle), 0.1 * angle], axis=-1)


def test_positions_between_times() -> None:
    track = Trajectory("t", TIMES, circle(TIMES))
    wanted = np.linspace(0.0, 4000.0, 333)
    np.testing.assert_allclose(track.at(wanted), circle(wanted), atol=0.01)
    np.testing.assert_allclose(track.at(TIMES), track.position, atol=1e-9)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_few_positions_are_joined_by_straight_lines(count: int) -> None:
    times = np.arange(count) * 10.0
    positions = np.arange(3.0 * count).reshape(count, 3)
    track = Trajectory("t", times, positions)
    np.testing.assert_allclose(track.at(times), positions)
    if count > 1:
        np.testing.assert_allclose(track.at([5.0])[0], positions[:2].mean(axis=0))


def test_nan_outside_and_in_long_gaps() -> None:
    track = Trajectory("t", [0.0, 10.0, 20.0, 500.0, 510.0], np.zeros((5, 3)))
    wanted = [-1.0, 0.0, 15.0, 20.0, 21.0, 499.0, 500.0, 505.0, 510.0, 511.0, np.nan]
    expected = [False, True, True, True, False, False, True, True, True, False, False]
    np.testing.assert_array_equal(track.covers(wanted, max_gap_s=10.0), expected)
    found = np.isfinite(track.at(wanted, max_gap_s=10.0)).all(axis=1)
    np.testing.assert_array_equal(found, expected)
    assert track.covers([250.0]).all()


def image(utc: str, scobj: list[float]) -> SpcImage:
    camera = Camera(100.0, [1.0, 1.0], [[50.0, 0, 0], [0, 50.0, 0]], 8, 8)
    return SpcImage("P", utc, camera, scobj, np.eye(3), [1.0, 0, 0], scobj_sigma=[1.0, 2.0, 3.0])


def test_from_images_sorts_by_time_and_negates_scobj() -> None:
    late, early = (
        image("2019 MAR 03 11:00:00", [1.0, 2, 3]),
        image("2019 MAR 03 10:00:00", [4.0, 5, 6]),
    )
    track = Trajectory.from_images([late, early], name="spc20")
    np.testing.assert_array_equal(track.position, [[-4, -5, -6], [-1, -2, -3]])
    np.testing.assert_array_equal(track.sigma, [[1, 2, 3], [1, 2, 3]])
    assert track.span == (et_from_utc("2019 MAR 03 10:00:00"), et_from_utc("2019 MAR 03 11:00:00"))
    with pytest.raises(InvalidValueError, match="does not follow"):
        Trajectory.from_images([late, late])


def test_a_smooth_offset_survives_times_far_apart() -> None:
    dense = np.linspace(-500.0, 4500.0, 5001)
    reference = Trajectory("ref", dense, circle(dense))
    bias = np.array([3.0, -2.0, 1.0])
    sparse = np.array([0.0, 1800.0, 4000.0])
    new = Trajectory("new", sparse, circle(sparse) + bias * (1 + sparse[:, None] / 4000))
    wanted = np.linspace(0, 4000, 99)
    offset = new.offset_from(reference)
    value = offset.shares(wanted) @ offset.differences.position
    np.testing.assert_allclose(value, bias * (1 + wanted[:, None] / 4000), atol=1e-5)
    # the positions themselves would be hundreds of metres off
    assert np.abs(new.at(wanted) - circle(wanted)).max() > 100.0


def test_the_widest_gap_says_how_much_may_be_off_between_states() -> None:
    times = np.array([0.0, 100.0, 300.0])
    positions = np.array([[0.0, 0, 0], [1.0, 0, 0], [1.0, 2.0, 0]])
    new = Trajectory("new", times, positions, np.zeros((3, 3)))
    offset = new.offset_from(Trajectory("ref", times, np.zeros((3, 3))))
    # Steps of 1 m in 100 s and 2 m in 200 s gather (0.01 + 0.02) / 2 m²/s; in the middle of a gap
    # a quarter of it is left of what gathers over the gap.
    assert offset.widest(1e3) == pytest.approx(np.sqrt(0.015 * 200.0 / 4.0))
    # Over gaps that are too long nothing is interpolated.
    assert offset.widest(150.0) == pytest.approx(np.sqrt(0.015 * 100.0 / 4.0))
    assert offset.widest(50.0) == 0.0


def test_bridge_sigma_is_what_random_walks_show() -> None:
    rng = np.random.default_rng(5)
    walks = np.cumsum(rng.normal(0, 0.1, (20_000, 3)), axis=0)
    walks[:, 1:] = walks[:, :1]
    times = np.arange(20_000.0)
    reference = Trajectory("ref", times, np.zeros_like(walks))
    knots = slice(None, None, 40)
    new = Trajectory("new", times[knots], walks[knots], np.zeros((500, 3)))
    middle = times[20:-40:40]
    offset = new.offset_from(reference)
    error = offset.shares(middle) @ offset.differences.position - walks[20:-40:40]
    # The three axes walk alike.
    assert np.sqrt(3.0) * np.std(error[:, 0]) == pytest.approx(offset.widest(1e3), rel=0.1)


def test_no_time_in_common() -> None:
    one, other = (Trajectory(n, [t, t + 1], np.zeros((2, 3))) for n, t in (("a", 0.0), ("b", 9.0)))
    with pytest.raises(InvalidValueError, match="b: covers no time of 'a'"):
        one.offset_from(other)


@pytest.mark.parametrize(
    ("time", "position", "message"),
    [
        ([], np.zeros((0, 3)), "no position"),
        ([0.0, 0.0], np.zeros((2, 3)), "time 2"),
        ([1.0, 0.0], np.zeros((2, 3)), "does not follow"),
        ([0.0, np.nan], np.zeros((2, 3)), "not finite"),
        ([0.0], [[np.nan, 0, 0]], "not finite"),
        ([0.0], np.zeros((2, 3)), "shape"),
    ],
)
def test_refuses_bad_values(time: list[float], position: np.ndarray, message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        Trajectory("t", time, position)


def test_shares_say_on_which_states_a_time_leans():
    reference = Trajectory("reference", [0.0, 10.0, 20.0, 40.0], np.zeros((4, 3)))
    newer = Trajectory("spc", [0.0, 10.0, 20.0, 40.0], np.ones((4, 3)))
    offset = newer.offset_from(reference)
    shares = offset.shares([0.0, 2.5, 15.0, 40.0, 50.0]).toarray()
    np.testing.assert_allclose(
        shares, [[1, 0, 0, 0], [0.75, 0.25, 0, 0], [0, 0.5, 0.5, 0], [0, 0, 0, 1], [0, 0, 0, 0]]
    )
