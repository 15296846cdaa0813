"""The search for the lidar's frame: planted turns, mirrors, units are named; nothing else is."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fusion.registration.search import FrameSearch, Placement, search_frames
from fusion.registration.search.frame_texts import LEAST_TURN_DEG, frame_change
from fusion.registration.search.orientations import all_orientations, apart_deg, distinct
from fusion.registration.search.search import significance_of
from spcola.arrays import FloatArray
from spcola.errors import NotObservableError

RADIUS = 40.0


def body(directions: FloatArray, seed: int, relief: float = 0.04) -> FloatArray:
    """Points (N, 3), metres, of a body as rough at all wavelengths from 180° to 10°."""
    draw = np.random.default_rng(seed)
    wave = draw.normal(size=(300, 3))
    wave /= np.linalg.norm(wave, axis=1, keepdims=True)
    number = np.exp(draw.uniform(np.log(2.0), np.log(36.0), 300))
    phase = draw.uniform(0.0, 2.0 * np.pi, 300)
    heights = np.cos(directions @ (wave * number[:, None]).T + phase) @ (1.0 / number)
    heights *= relief / np.sqrt(0.5 * np.sum(number**-2.0))
    points: FloatArray = RADIUS * (1.0 + heights)[:, None] * directions
    return points


def directions_of(count: int, seed: int) -> FloatArray:
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    units: FloatArray = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return units


def lidar_of(seed: int, count: int = 12_000, relief: float = 0.04) -> FloatArray:
    """Returns of the body of a seed with the noise of ranges."""
    units = directions_of(count, 1000 + seed)
    noise = np.random.default_rng(2000 + seed).normal(0.0, 0.05, (count, 1))
    returns: FloatArray = body(units, seed, relief) + noise * units
    return returns


@pytest.fixture(scope="module")
def surface() -> FloatArray:
    """SPC's surface of body 1, with errors."""
    units = directions_of(30_000, 7)
    errors = np.random.default_rng(8).normal(0.0, 0.15, (len(units), 1))
    points: FloatArray = body(units, 1) + errors * units
    return points


def rotation(angle_deg: float, axis: tuple[float, float, float]) -> FloatArray:
    matrix: FloatArray = Rotation.from_rotvec(
        np.radians(angle_deg) * np.array(axis) / np.linalg.norm(axis)
    ).as_matrix()
    return matrix


def off_deg(search: FrameSearch, planted: FloatArray) -> float:
    """Angle between the orientation found and that which undoes what was planted."""
    matrix = planted / np.cbrt(abs(np.linalg.det(planted)))
    return float(apart_deg(matrix.T, search.candidates[0].placement.matrix[None])[0])


FLIP_X, FLIP_Y = np.diag([-1.0, 1.0, 1.0]), np.diag([1.0, -1.0, 1.0])


@pytest.mark.parametrize(
    ("planted", "kinds", "text"),
    [
        (rotation(2.9, (0, 0, 1)), ("turn",), "the lidar fits when turned by −2.9° about Z"),
        pytest.param(
            FLIP_Y, ("mirror",),
            "the lidar fits when mirrored in Y (longitudes of the other sign)",
            marks=pytest.mark.slow,
        ),
        (
            1e-3 * FLIP_X @ rotation(40.0, (1, -2, 0.5)),
            ("mirror", "turn", "unit"),
            "the lidar fits when mirrored in ",
        ),
    ],
)  # fmt: skip
def test_what_was_planted_is_named(
    surface: FloatArray, planted: FloatArray, kinds: tuple[str, ...], text: str
) -> None:
    search = search_frames(lidar_of(1) @ planted.T, surface)
    assert search.found
    assert search.candidates[0].change.changes == kinds
    assert search.text.startswith(text)
    assert off_deg(search, planted) < 0.15
    assert search.candidates[0].placement.scale * np.cbrt(abs(np.linalg.det(planted))) == (
        pytest.approx(1.0, abs=1e-3)
    )


def test_a_hemisphere_that_is_shifted_and_too_large_is_found(surface: FloatArray) -> None:
    seen = lidar_of(1)
    seen = seen[seen @ np.array([0.2, 0.5, 0.8]) > 0.0]
    search = search_frames(1.06 * seen + np.array([2.0, -1.0, 0.5]), surface)
    best = search.best
    assert best is not None
    assert set(best.change.changes) == {"scale", "shift"}
    assert best.placement.scale == pytest.approx(1.0 / 1.06, abs=2e-3)
    np.testing.assert_allclose(
        best.placement.translation, np.array([-2.0, 1.0, -0.5]) / 1.06, atol=0.1
    )


@pytest.mark.parametrize(
    "wrong", ["other body", "cloud", pytest.param("sphere", marks=pytest.mark.slow)]
)
def test_what_fits_nowhere_is_not_found(surface: FloatArray, wrong: str) -> None:
    draw = np.random.default_rng(5)
    if wrong == "other body":
        lidar = lidar_of(2)
    elif wrong == "cloud":
        lidar = directions_of(12_000, 3) * draw.uniform(30.0, 50.0, (12_000, 1))
    else:
        lidar = lidar_of(1, relief=0.0)
    search = search_frames(lidar, surface)
    assert not search.found
    assert search.best is None
    assert search.text.startswith("no rotation, mirrored axis, unit or shift makes the lidar fit")


@pytest.mark.slow
def test_hardly_any_other_body_is_found() -> None:
    # Fifty pairs of bodies: with a rate of 1 % none is the likeliest number.
    found = 0
    for seed in range(50):
        units = directions_of(20_000, seed)
        found += search_frames(lidar_of(seed), body(units, 500 + seed)).found
    assert found == 0


def test_too_few_points_are_refused(surface: FloatArray) -> None:
    with pytest.raises(NotObservableError, match="are too few"):
        search_frames(lidar_of(1)[:20], surface)


def test_significance_is_that_above_the_best_of_wrong_places() -> None:
    wrong = np.tanh(np.linspace(-0.1, 0.1, 41))
    spread = np.linspace(-0.1, 0.1, 41).std()
    assert significance_of(float(np.tanh(0.5)), wrong) == pytest.approx(0.4 / spread)
    assert significance_of(0.99, wrong[:10]) == 0.0


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1, 2, 3)])
@pytest.mark.parametrize("angle", [-170.0, -10.0, 0.4, 90.0, 180.0])
def test_words_state_the_turn(axis: tuple[float, float, float], angle: float) -> None:
    at = Placement(rotation(angle, axis), np.zeros(3), 1.0)
    change = frame_change(at, RADIUS, 0.1)
    assert change.changes == ("turn",)
    again = rotation(change.angle_deg, tuple(change.axis))
    np.testing.assert_allclose(again, at.matrix, atol=1e-12)


@pytest.mark.parametrize(("axis", "row"), [("X", 0), ("Y", 1), ("Z", 2)])
def test_words_state_the_mirrored_axis(axis: str, row: int) -> None:
    flip = np.eye(3)
    flip[row, row] = -1.0
    change = frame_change(Placement(rotation(10.0, (0, 0, 1)) @ flip, np.zeros(3), 1.0), 40.0, 0.1)
    assert change.changes == ("mirror", "turn")
    assert change.mirrored == axis
    assert f"mirrored in {axis}" in change.text
    assert change.text.endswith("and turned by 10.0° about Z")


def test_words_for_axes_in_another_order() -> None:
    order = np.eye(3)[[1, 2, 0]]
    change = frame_change(Placement(order, np.zeros(3), 1.0), 40.0, 0.1)
    assert "its axes Y, Z, X taken as X, Y, Z" in change.text


def test_small_changes_are_not_named() -> None:
    at = Placement(rotation(0.9 * LEAST_TURN_DEG, (0, 1, 0)), np.full(3, 0.1), 1.0004)
    assert frame_change(at, 40.0, 0.1).text == "fits as it is"


def test_orientations_leave_no_gap() -> None:
    orientations = all_orientations(30_000)
    np.testing.assert_allclose(
        orientations @ orientations.transpose(0, 2, 1),
        np.broadcast_to(np.eye(3), orientations.shape),
        atol=1e-12,
    )
    for seed, matrix in enumerate(Rotation.random(40, random_state=3).as_matrix()):
        aimed = matrix if seed % 2 else -matrix
        assert apart_deg(aimed, orientations).min() < 8.0


def test_distinct_orientations_are_apart_and_the_best() -> None:
    orientations = all_orientations(300)
    score = np.random.default_rng(1).normal(size=len(orientations))
    chosen = distinct(orientations, score, 30.0, 12)
    assert chosen[0] == score.argmax()
    assert (np.diff(score[chosen]) <= 0.0).all()
    for k, row in enumerate(chosen):
        assert apart_deg(orientations[row], orientations[np.delete(chosen, k)]).min() >= 30.0
