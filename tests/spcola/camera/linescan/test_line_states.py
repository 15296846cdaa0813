from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spcola.camera.instrument import Pupil
from spcola.camera.linescan import interpolate_axes, interpolate_positions
from spcola.errors import InvalidValueError

TIMES = np.linspace(0.0, 100.0, 11)
WANTED = np.linspace(0.0, 100.0, 73)
RATE = 1e-3


def orbit(times):
    angle = RATE * times
    return 1e4 * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])


def velocity(times):
    angle = RATE * times
    return 1e4 * RATE * np.column_stack([-np.sin(angle), np.cos(angle), 0 * angle])


def test_positions_of_an_orbit() -> None:
    # the error of Hermite's cubic is h⁴ a ω² / 384 = 2.6e-7 m
    found = interpolate_positions(TIMES, orbit(TIMES), WANTED, velocities=velocity(TIMES))
    np.testing.assert_allclose(found, orbit(WANTED), atol=3e-7)
    np.testing.assert_allclose(
        interpolate_positions(TIMES, orbit(TIMES), WANTED), orbit(WANTED), atol=1e-5
    )


@pytest.mark.parametrize("count", [2, 3])
def test_few_states_give_a_line_or_a_parabola(count: int) -> None:
    known = np.linspace(0.0, 10.0, count)
    path = np.column_stack([known ** (count - 1), known, np.ones(count)])
    at = np.array([2.5, 7.5])
    expected = np.column_stack([at ** (count - 1), at, np.ones(2)])
    np.testing.assert_allclose(interpolate_positions(known, path, at), expected, atol=1e-12)


@pytest.mark.parametrize("method", ["slerp", "cubic"])
def test_a_steady_turn_is_met_exactly(method) -> None:
    def turn(times):
        return Rotation.from_rotvec(np.outer(times, [1e-3, -2e-3, 5e-4])).as_matrix()

    found = interpolate_axes(TIMES, turn(TIMES), WANTED, method=method)
    np.testing.assert_allclose(found, turn(WANTED), atol=1e-13)


def test_the_cubic_follows_an_accelerated_turn() -> None:
    def turn(times):
        return Rotation.from_rotvec(np.outer(1e-5 * times**2, [0.6, 0.0, 0.8])).as_matrix()

    # away from the ends, where the spline's acceleration is zero
    middle = WANTED[(WANTED > 30) & (WANTED < 70)]
    slerp = interpolate_axes(TIMES, turn(TIMES), middle)
    cubic = interpolate_axes(TIMES, turn(TIMES), middle, method="cubic")
    assert np.max(np.abs(slerp - turn(middle))) > 1e-4
    assert np.max(np.abs(cubic - turn(middle))) < 1e-5


def test_one_state_is_that_of_all_times() -> None:
    assert interpolate_positions(TIMES[:1], orbit(TIMES[:1]), WANTED[:5]).shape == (5, 3)


def test_nothing_is_extrapolated() -> None:
    with pytest.raises(InvalidValueError, match=r"cover 0\.000 to 100\.000 s"):
        interpolate_positions(TIMES, orbit(TIMES), np.array([100.1]))


def test_times_must_increase() -> None:
    with pytest.raises(InvalidValueError, match="do not increase"):
        interpolate_positions(np.array([0.0, 2.0, 2.0]), np.zeros((3, 3)), np.array([1.0]))


def test_a_pupil_turns_with_its_spacecraft() -> None:
    pupil = Pupil("NAC", [0.0, 2.0, 0.5])
    about_z = Rotation.from_rotvec([0, 0, np.pi / 2]).as_matrix().T  # rows: spacecraft's x is +y
    np.testing.assert_allclose(pupil.position([10.0, 0, 0], about_z), [8.0, 0.0, 0.5], atol=1e-12)
    both = pupil.position(np.zeros((2, 3)), np.stack([np.eye(3), about_z]))
    np.testing.assert_allclose(both, [[0, 2, 0.5], [-2, 0, 0.5]], atol=1e-12)
    with pytest.raises(InvalidValueError, match="no name"):
        Pupil(" ", [0, 0, 0])
