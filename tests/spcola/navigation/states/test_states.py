"""States of images: values, tables over time, and comparison."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spcola.camera import Camera, rotate_axes
from spcola.errors import InvalidValueError
from spcola.navigation import Spin, utc_from_et
from spcola.navigation.states import (
    ImageState,
    PositionTable,
    RotationTable,
    StateSource,
    StateTables,
    compare_states,
)

SPIN = Spin(85.6, -60.2, 150.0, 2011.15)
CAMERA = Camera(628.9, [512.5, 512.5], [[117.6, 0, 0], [0, 117.6, 0]], 1024, 1024)
AXES = Rotation.from_rotvec([0.3, -1.2, 0.7]).as_matrix()


def make_state(**changed):
    values = {
        "name": "P1",
        "time": 6.0e8,
        "scobj": AXES.T @ [30.0, -20.0, 5000.0],
        "axes": AXES,
        "source": StateSource.SPICE,
        "sun": np.array([1.0, 0.0, 0.0]),
        "velocity": np.array([0.01, 0.1, -0.05]),
    }
    return ImageState(**{**values, **changed})


def quaternions(matrices):
    return Rotation.from_matrix(matrices).as_quat()[:, [3, 0, 1, 2]]


def test_an_image_has_its_state_back():
    state = make_state(scobj_sigma=[1.0, 2.0, 3.0], pointing_sigma=[1e-5, 2e-5, 3e-5])
    again = ImageState.of_image(state.as_image(CAMERA))
    assert again.source is StateSource.SUM
    assert abs(again.time - state.time) < 6e-4
    for name in ("scobj", "axes", "sun", "scobj_sigma", "pointing_sigma"):
        np.testing.assert_array_equal(getattr(again, name), getattr(state, name))
    np.testing.assert_allclose(state.position, -state.scobj)


def test_the_nominal_velocity_is_the_rate_of_the_body_fixed_position():
    # A spacecraft at rest in an inertial frame circles a rotating body.
    rate = np.radians(SPIN.rate_deg_per_day) / 86400.0
    inertial = np.array([3000.0, 1000.0, 2000.0])
    at, later = (SPIN.axes([t])[0] @ inertial for t in (6.0e8, 6.0e8 + 1.0))
    nominal = make_state(scobj=-at, velocity=np.zeros(3)).as_nominal([0.0, 0.0, rate])
    np.testing.assert_allclose(nominal.velocity, later - at, atol=1e-3 * rate * 4000.0)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"sun": [2.0, 0.0, 0.0]}, "unit vector"),
        ({"axes": -AXES}, "left-handed"),
        ({"scobj": [np.nan, 0.0, 0.0]}, "not finite"),
    ],
)
def test_wrong_states_are_refused(change, text):
    with pytest.raises(InvalidValueError, match=text):
        make_state(**change)


def test_an_image_without_time_or_sun_makes_no_sum_file():
    with pytest.raises(InvalidValueError, match="no time"):
        make_state(time=np.nan).as_image(CAMERA)
    with pytest.raises(InvalidValueError, match="sun"):
        make_state(sun=np.full(3, np.nan)).as_image(CAMERA)


def make_tables(count, *, backward=False):
    """Tables of a spacecraft on a line, turning evenly, above an evenly rotating body."""
    times = 6.0e8 + np.linspace(0.0, 20.0, count) if count > 1 else np.array([6.0e8 + 10.0])
    start, velocity = np.array([3.0e3, 4.0e3, -1.0e3]), np.array([0.2, -0.1, 0.05])
    place = start + (times - 6.0e8)[:, None] * velocity
    first = Rotation.align_vectors([[0, 0, 1]], [-start])[0]
    flip = np.diag([1.0, -1.0, -1.0]) if backward else np.eye(3)
    turns = [Rotation.from_rotvec([0, 0, 1e-3 * (t - 6.0e8)]) * first for t in times]
    constant = Rotation.from_rotvec([0.0, 0.2, 0.1]).as_matrix()
    pointing = np.array([constant.T @ flip @ turn.as_matrix() for turn in turns])
    return StateTables(
        RotationTable(times, quaternions(pointing), constant),
        PositionTable(times, place, np.broadcast_to(velocity, place.shape)),
        RotationTable(times, quaternions(SPIN.axes(times))),
        PositionTable(times, np.broadcast_to([1.5e11, 0.0, 1e10], place.shape)),
        StateSource.ISIS,
    )


@pytest.mark.parametrize("count", [1, 2, 7])
def test_tables_give_the_planted_state(count):
    tables = make_tables(count)
    moment = 6.0e8 + 10.0 if count < 3 else 6.0e8 + 7.3
    state = tables.state("P1", moment)
    turn = SPIN.axes([moment])[0]
    np.testing.assert_allclose(
        turn.T @ state.position,
        np.array([3.0e3, 4.0e3, -1.0e3]) + (moment - 6.0e8) * np.array([0.2, -0.1, 0.05]),
        atol=1e-5,
    )
    np.testing.assert_allclose(turn.T @ state.velocity, [0.2, -0.1, 0.05], atol=1e-9)
    np.testing.assert_allclose(turn.T @ state.sun, [0.997785158, 0, 0.0665190105], atol=1e-8)
    assert state.axes[2] @ state.scobj > 0.99 * np.linalg.norm(state.scobj)
    assert tables.state("P1").time == 6.0e8 + 10.0


def test_a_camera_that_looks_backward_gets_its_boresight_as_cz():
    usual, turned = make_tables(3), make_tables(3, backward=True)
    assert not usual.backward
    assert turned.backward
    np.testing.assert_allclose(turned.state("P1").axes, usual.state("P1").axes, atol=1e-9)


def test_a_time_outside_the_tables_is_refused_with_the_gap():
    with pytest.raises(InvalidValueError, match=r"12\.000 s outside"):
        make_tables(3).state("P1", 6.0e8 + 32.0)


def test_tables_that_are_none_are_refused():
    with pytest.raises(InvalidValueError, match="row 2 does not follow"):
        RotationTable([1.0, 1.0], np.eye(4)[:2])
    with pytest.raises(InvalidValueError, match="unit length"):
        RotationTable([1.0], [[1.0, 1.0, 0.0, 0.0]])
    with pytest.raises(InvalidValueError, match="no row"):
        PositionTable([], np.empty((0, 3)))


def test_two_positions_without_velocity_are_joined_by_a_straight_line():
    table = PositionTable([0.0, 2.0], [[0.0, 0.0, 0.0], [2.0, 4.0, 6.0]])
    place, velocity = table.at([0.5])
    np.testing.assert_allclose(place, [[0.5, 1.0, 1.5]])
    assert np.isnan(velocity).all()


def test_the_difference_of_two_states_is_the_planted_one():
    two = make_state()
    turn, shift = np.array([2e-5, -1e-5, 3e-5]), np.array([1.0, -2.0, 3.0])
    one = make_state(
        scobj=two.scobj - AXES.T @ shift,
        axes=rotate_axes(AXES, turn),
        time=two.time + 0.25,
        source=StateSource.POSES,
    )
    found = compare_states(one, two, CAMERA)
    assert found.sources == (StateSource.POSES, StateSource.SPICE)
    assert found.time_s == 0.25
    np.testing.assert_allclose(found.camera_m, shift, atol=1e-9)
    np.testing.assert_allclose(found.pointing, turn, atol=1e-9)
    assert np.linalg.norm(found.track_m) == pytest.approx(np.linalg.norm(shift))
    # A shift of the pupil by x, and a turn about Cy, move the ground by these pixels.
    per_pixel = CAMERA.pixel_angle
    expected = [
        (-shift[0] / 5000.0 - turn[1]) / per_pixel,
        (-shift[1] / 5000.0 + turn[0]) / per_pixel,
    ]
    np.testing.assert_allclose(found.pixels, expected, rtol=2e-3)
    assert found.as_json()["pointing_deg"] == pytest.approx(np.degrees(turn), abs=1e-7)


def test_along_track_is_along_the_velocity_and_radial_outward():
    two = make_state(scobj=[-5000.0, 0.0, 0.0], velocity=[0.3, 0.0, 2.0])
    one = make_state(scobj=[-5003.0, -1.0, -2.0], velocity=np.full(3, np.nan))
    # x × z = −y is across.
    np.testing.assert_allclose(compare_states(one, two).track_m, [2.0, -1.0, 3.0])
    blind = make_state(scobj=[-5000.0, 0.0, 0.0], velocity=np.full(3, np.nan))
    found = compare_states(make_state(scobj=[-5003.0, 0, 0], velocity=np.full(3, np.nan)), blind)
    assert np.isnan(found.track_m[:2]).all()
    assert found.track_m[2] == 3.0
    assert np.isnan(found.pixels).all()


def test_states_of_two_images_are_not_compared():
    with pytest.raises(InvalidValueError, match="compare one image"):
        compare_states(make_state(), make_state(name="P2"))


def test_a_date_is_in_the_message():
    with pytest.raises(InvalidValueError, match=utc_from_et(6.0e8)):
        make_tables(3).state("P1", 7.0e8)
