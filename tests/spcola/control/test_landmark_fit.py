from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spcola.arrays import FloatArray
from spcola.camera import Camera, SpcImage, project_image, rotate_axes
from spcola.control.estimation import landmark_fit, solve_landmark
from spcola.control.estimation.landmark_fit import (
    LANDMARK_PARAMETERS,
    Prior,
    solve_normal,
    solve_state,
)
from spcola.errors import InvalidValueError, NotObservableError
from spcola.formats.solution import read_landmark, read_summary

CAMERA = Camera(
    150.0, [512.5, 500.0], [[71.4, 0.2, 0.0], [0.1, -71.5, 0.0]], 1024, 1024, "owen",
    [2e-5, 0.0, 1e-5, -1e-5],
)  # fmt: skip
LANDMARKS = np.random.default_rng(1).uniform(-200, 200, (30, 3))


def looking_from(position: FloatArray) -> SpcImage:
    boresight = -position / np.linalg.norm(position)
    across = np.cross(boresight, [0.1, 0.2, 1.0])
    across /= np.linalg.norm(across)
    axes = np.stack([across, np.cross(boresight, across), boresight])
    return SpcImage("P", "2019 MAR 03 10:00:00", CAMERA, -position, axes, [1.0, 0, 0])


def ring(count: int, distance: float = 3000.0) -> list[SpcImage]:
    turns = np.linspace(0.0, 1.5, count)
    return [looking_from(distance * np.array([np.cos(t), np.sin(t), 0.3 + 0.1 * t])) for t in turns]


def test_a_planted_landmark_is_recovered_exactly() -> None:
    images, truth = ring(5), np.array([100.0, 80.0, -50.0])
    observed = [project_image(image, truth) for image in images]
    found = solve_landmark(truth + np.array([30.0, -20.0, 40.0]), images, observed, 0.3)
    np.testing.assert_allclose(found.estimate, truth, atol=1e-8)
    np.testing.assert_allclose(found.residuals, 0.0, atol=1e-9)
    assert found.converged
    assert found.iterations < 8
    assert "sigma" in found.reason


def test_landmark_sigma_is_the_scatter_of_noisy_solutions() -> None:
    images, truth = ring(4), np.array([100.0, 80.0, -50.0])
    exact = np.array([project_image(image, truth) for image in images])
    rng = np.random.default_rng(2)
    solutions = [
        solve_landmark(truth, images, exact + rng.normal(0, 0.5, exact.shape), 0.5)
        for _ in range(250)
    ]
    errors = np.array([s.estimate - truth for s in solutions])
    normalised = np.einsum("ni,ij,nj->n", errors, np.linalg.inv(solutions[0].covariance), errors)
    assert np.mean(normalised) == pytest.approx(3.0, rel=0.1)


def test_one_image_leaves_the_line_of_sight_free() -> None:
    image, truth = looking_from(np.array([3000.0, 0, 0])), np.array([200.0, 0.0, 0.0])
    observed = [project_image(image, truth)]
    with pytest.raises(NotObservableError) as raised:
        solve_landmark(truth, [image], observed, 0.3)
    assert raised.value.parameters == ("V x",)
    prior = Prior(truth, np.array([5.0, np.nan, np.nan]))
    found = solve_landmark(truth + np.array([1.0, 2.0, 3.0]), [image], observed, 0.3, prior=prior)
    np.testing.assert_allclose(found.estimate, truth, atol=1e-5)
    assert found.sigma[0] == pytest.approx(5.0, rel=1e-3)


def test_prior_and_observations_are_weighed_by_their_information() -> None:
    # to a part in a thousand: the partials are those at the solution, 1 m in 3 km from the truth
    images, truth = ring(6), np.array([100.0, 80.0, -50.0])
    observed = [project_image(image, truth) for image in images]
    alone = solve_landmark(truth, images, observed, 0.3)
    tight = Prior(truth + 1.0, np.full(3, 0.2))
    both = solve_landmark(truth, images, observed, 0.3, prior=tight)
    information = np.linalg.inv(alone.covariance) + np.eye(3) / 0.2**2
    np.testing.assert_allclose(both.covariance, np.linalg.inv(information), rtol=1e-3)
    expected = truth + np.linalg.solve(information, np.ones(3) / 0.2**2)
    np.testing.assert_allclose(both.estimate, expected, atol=1e-3)


def test_uncertain_states_weigh_less_and_widen_the_covariance() -> None:
    images, truth = ring(4), np.array([100.0, 80.0, -50.0])
    vague = [replace(i, scobj_sigma=[5.0] * 3, pointing_sigma=[1e-4] * 3) for i in images]
    observed = [project_image(image, truth) for image in images]
    sharp = solve_landmark(truth, images, observed, 0.3)
    wide = solve_landmark(truth, vague, observed, 0.3)
    assert np.all(wide.sigma > 3 * sharp.sigma)


@pytest.mark.parametrize("prior", [True, False])
def test_a_planted_state_is_recovered_exactly(prior: bool) -> None:
    truth = looking_from(np.array([900.0, 400.0, 300.0]))
    observed = np.stack(project_image(truth, LANDMARKS), axis=1)
    start = replace(
        truth,
        axes=rotate_axes(truth.axes, [2e-3, -3e-3, 4e-3]),
        scobj=truth.scobj + np.array([20.0, -10.0, 15.0]),
    )
    loose = replace(start, scobj_sigma=[1e6] * 3, pointing_sigma=[1e3] * 3)
    found = solve_state(loose if prior else start, LANDMARKS, observed, 0.3, use_prior=prior)
    assert found.converged
    np.testing.assert_allclose(found.image.scobj, truth.scobj, atol=1e-5)
    np.testing.assert_allclose(found.image.axes, truth.axes, atol=1e-8)
    np.testing.assert_allclose(found.residuals, 0.0, atol=1e-6)
    np.testing.assert_allclose(found.image.scobj_sigma**2, np.diag(found.covariance)[3:])


def test_state_covariance_is_the_scatter_of_noisy_solutions() -> None:
    truth = looking_from(np.array([900.0, 400.0, 300.0]))
    exact = np.stack(project_image(truth, LANDMARKS), axis=1)
    rng = np.random.default_rng(3)
    errors = []
    for _ in range(300):
        noisy = exact + rng.normal(0, 0.5, exact.shape)
        found = solve_state(truth, LANDMARKS, noisy, 0.5, use_prior=False)
        turn = -Rotation.from_matrix(found.image.axes @ truth.axes.T).as_rotvec()
        errors.append(np.concatenate([turn, found.image.scobj - truth.scobj]))
    stacked = np.array(errors)
    normalised = np.einsum("ni,ij,nj->n", stacked, np.linalg.inv(found.covariance), stacked)
    assert np.mean(normalised) == pytest.approx(6.0, rel=0.1)


def test_a_tight_prior_holds_the_state() -> None:
    truth = looking_from(np.array([900.0, 400.0, 300.0]))
    observed = np.stack(project_image(truth, LANDMARKS), axis=1)
    turned = rotate_axes(truth.axes, [1e-3, 2e-3, -1e-3])
    start = replace(
        truth, axes=turned, scobj=truth.scobj + 5.0, scobj_sigma=[1e-6] * 3,
        pointing_sigma=[1e-12] * 3,
    )  # fmt: skip
    found = solve_state(start, LANDMARKS, observed, 0.3)
    np.testing.assert_allclose(found.image.scobj, start.scobj, atol=1e-5)
    np.testing.assert_allclose(found.image.axes, turned, atol=1e-8)


def test_the_pointing_prior_pulls_back_to_where_it_began() -> None:
    truth = looking_from(np.array([900.0, 400.0, 300.0]))
    observed = np.stack(project_image(truth, LANDMARKS), axis=1)
    turn = np.array([1e-3, 0.0, 0.0])
    start = replace(
        truth, axes=rotate_axes(truth.axes, turn), scobj_sigma=[1e-6] * 3, pointing_sigma=[1e-4] * 3
    )
    loose = solve_state(replace(start, pointing_sigma=[1e3] * 3), LANDMARKS, observed, 30.0)
    found = solve_state(start, LANDMARKS, observed, 30.0)
    data = np.linalg.inv(loose.covariance[:3, :3])
    pulled = -np.linalg.solve(data + np.eye(3) / 1e-4**2, data @ turn)
    moved = -Rotation.from_matrix(found.image.axes @ start.axes.T).as_rotvec()
    np.testing.assert_allclose(moved, pulled, rtol=0.02, atol=2e-6)


def test_two_landmarks_do_not_make_a_state() -> None:
    truth = looking_from(np.array([900.0, 400.0, 300.0]))
    observed = np.stack(project_image(truth, LANDMARKS[:2]), axis=1)
    with pytest.raises(NotObservableError, match="free"):
        solve_state(truth, LANDMARKS[:2], observed, 0.3, use_prior=False)
    known = replace(truth, scobj_sigma=[5.0] * 3, pointing_sigma=[1e-3] * 3)
    assert solve_state(known, LANDMARKS[:2], observed, 0.3).converged


def test_landmark_sigma_widens_the_state() -> None:
    truth = looking_from(np.array([900.0, 400.0, 300.0]))
    observed = np.stack(project_image(truth, LANDMARKS), axis=1)
    sharp = solve_state(truth, LANDMARKS, observed, 0.3, use_prior=False)
    wide = solve_state(
        truth, LANDMARKS, observed, 0.3, landmark_sigma=np.full((30, 3), 2.0), use_prior=False
    )
    assert np.all(np.diag(wide.covariance) > 4 * np.diag(sharp.covariance))


def test_running_out_of_steps_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(landmark_fit, "_MOST_STEPS", 1)
    images, truth = ring(5), np.array([100.0, 80.0, -50.0])
    observed = [project_image(image, truth) for image in images]
    found = solve_landmark(truth + 100.0, images, observed, 0.3)
    assert not found.converged
    assert "after 1" in found.reason


def test_a_start_behind_the_camera_is_refused() -> None:
    images = ring(3)
    with pytest.raises(InvalidValueError, match="behind a camera"):
        solve_landmark([1e5, 1e5, 1e4], images, np.full((3, 2), 500.0), 0.3)


def test_normal_equations_name_what_is_free() -> None:
    rank_one = np.outer([1.0, 1.0, 0.0], [1.0, 1.0, 0.0]) + np.diag([0.0, 0.0, 1.0])
    with pytest.raises(NotObservableError) as raised:
        solve_normal(rank_one, np.ones(3), LANDMARK_PARAMETERS)
    assert raised.value.parameters == ("V x", "V y")
    with pytest.raises(NotObservableError, match="V z"):
        solve_normal(np.diag([1.0, 1.0, 0.0]), np.ones(3), LANDMARK_PARAMETERS)


def test_units_of_very_different_size_are_no_deficiency() -> None:
    matrix = np.diag([1e-12, 1.0, 1e14])
    step, covariance = solve_normal(matrix, np.ones(3), LANDMARK_PARAMETERS)
    np.testing.assert_allclose(step, [1e12, 1.0, 1e-14])
    np.testing.assert_allclose(np.diag(covariance), [1e12, 1.0, 1e-14])


@pytest.mark.parametrize(
    ("observed", "sigma", "message"),
    [
        (np.zeros((2, 2)), 0.3, "observed"),
        (np.full((3, 2), np.nan), 0.3, "not finite"),
        (np.zeros((3, 2)), 0.0, "positive"),
        (np.zeros((3, 2)), [0.3, 0.3], "sigma_px"),
    ],
)
def test_refuses_bad_observations(observed: FloatArray, sigma: float, message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        solve_landmark(np.zeros(3), ring(3), observed, sigma)


@pytest.mark.real_data
def test_67p_state_fits_its_landmarks_better_within_its_prior(shared_data: Path) -> None:
    folder = shared_data / "rosetta_67p"
    shot = read_summary(folder / "W48230079013.SUM")
    centers = [read_landmark(folder / f"{s.name}.LMK").grid.center for s in shot.landmarks]
    observed = [(s.pixel, s.line) for s in shot.landmarks]
    before = np.array(observed) - np.stack(project_image(shot, centers), axis=1)
    found = solve_state(shot, centers, observed, 0.5)
    assert found.converged
    assert np.sum(found.residuals**2) < np.sum(before**2)
    assert np.linalg.norm(found.image.scobj - shot.scobj) < 3 * np.linalg.norm(shot.scobj_sigma)
