"""3D rms and ICP: exact on surfaces known by formula, and on the truth body."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fusion.truth.assessment import AssessmentSettings
from fusion.truth.assessment.distances import center_of_figure, measure_distances, truth_center
from fusion.truth.assessment.rigid import RigidOptions, fit_rigid
from spcola.math import lattice
from spcola.shape.icq import IcqShape, icq_directions
from spcola.truth.body import BodySettings, TruthBody

SETTINGS = AssessmentSettings(fit_vertices=4000)
SHIFT = np.array([0.06, -0.08, 0.0])  # 10 cm


@pytest.fixture(scope="module")
def body() -> TruthBody:
    return TruthBody(BodySettings(radius=40.0))


def measured(points, truth):
    return measure_distances(points, truth, SETTINGS, None)


def test_a_perfect_model_scores_zero(top, body) -> None:
    for truth in (top, body):
        directions = lattice(1500)
        found = measured(truth.radius(directions)[:, None] * directions, truth)
        assert max(found.rms, found.rms_without_offset, found.rms_optimised) < 1e-6
        assert found.largest < 1e-6
        assert found.rigid.converged


def test_a_model_moved_by_10_cm_scores_10_cm_and_zero_when_optimised(top) -> None:
    # Of a whole body moved by d a vertex is d·n off; on the average over a sphere d / √3.
    points = top.points(lattice(4000))
    found = measured(points + SHIFT, top)
    normals = top.nearest(points).normals
    assert found.rms == pytest.approx(np.sqrt(np.mean((normals @ SHIFT) ** 2)), rel=1e-3)
    assert found.rms == pytest.approx(0.1 / np.sqrt(3.0), rel=0.1)
    np.testing.assert_allclose(found.translation.translation, -SHIFT, atol=1e-7)
    assert np.linalg.norm(found.translation.translation) == pytest.approx(0.1, abs=1e-7)
    assert found.rms_without_offset < 1e-7
    assert found.rms_optimised < 1e-7


def test_on_rough_ground_too(body) -> None:
    directions = lattice(4000)
    points = body.radius(directions)[:, None] * directions
    turn = Rotation.from_rotvec(np.radians([0.1, -0.05, 0.08]))
    found = measured(turn.apply(points) + SHIFT, body)
    assert found.rms > 0.05
    assert found.rms_optimised < 1e-5
    np.testing.assert_allclose(found.rigid.rotation, -turn.as_rotvec(), atol=1e-6)


def test_a_raised_model_scores_its_rise_and_keeps_it(ball) -> None:
    found = measured(1.1 / 75.0 * ball.points(lattice(3000)) + ball.points(lattice(3000)), ball)
    assert found.mean == pytest.approx(1.1)
    assert found.rms_optimised == pytest.approx(1.1)


def test_a_scale_is_not_absorbed(top, body) -> None:
    for truth in (top, body):
        directions = lattice(4000)
        points = truth.radius(directions)[:, None] * directions
        found = measured(1.0005 * points, truth)
        rises = 0.0005 * np.sum(points * truth.nearest(points).normals, axis=1)
        expected = np.sqrt(np.mean(rises**2))
        assert found.rms == pytest.approx(expected, rel=0.02)
        assert found.rms_optimised == pytest.approx(expected, rel=0.02)
        assert found.mean == pytest.approx(np.mean(rises), rel=0.02)


def test_shift_and_turn_are_found_together(top) -> None:
    turn = Rotation.from_rotvec([0.001, -0.002, 0.003])
    points = top.points(lattice(3000))
    fit = fit_rigid(turn.apply(points) + SHIFT, top)
    assert fit.converged
    assert not fit.reason
    assert fit.rms < 1e-9
    np.testing.assert_allclose(fit.apply(turn.apply(points) + SHIFT), points, atol=1e-6)


def test_gross_errors_do_not_lead_astray(top) -> None:
    points = top.points(lattice(3000))
    turn = Rotation.from_rotvec([0.0, 0.0, 0.1])
    wrong = turn.apply(points) + SHIFT
    wrong[::100] *= 1.2
    fit = fit_rigid(wrong, top)
    assert fit.converged
    # The definition counts every vertex: no motion to any side makes the rms less.
    moved = fit.apply(wrong)
    for step in 0.02 * np.vstack([np.eye(3), -np.eye(3)]):
        assert np.sqrt(np.mean(top.nearest(moved + step).distance ** 2)) > fit.rms


def test_sigmas_are_those_of_the_fit(top) -> None:
    points, pulls = top.points(lattice(1200)), []
    normals = top.nearest(points).normals
    for seed in range(25):
        noise = 0.1 * np.random.default_rng(seed).normal(size=(len(points), 1))
        fit = fit_rigid(points + noise * normals, top)
        found = np.concatenate([fit.translation, fit.rotation])
        pulls.append(found / np.sqrt(np.diag(fit.covariance)))
    assert np.sqrt(np.mean(np.square(pulls))) == pytest.approx(1.0, abs=0.2)


def test_the_rotation_of_a_sphere_is_not_observable(ball) -> None:
    fit = fit_rigid(ball.points(lattice(2000)) + SHIFT, ball)
    assert fit.converged
    assert "rotation" in fit.reason
    assert np.isnan(fit.covariance[3:]).all()
    np.testing.assert_allclose(fit.rotation, 0.0, atol=1e-6)


def test_a_translation_alone_has_no_rotation(top) -> None:
    fit = fit_rigid(top.points(lattice(500)), top, options=RigidOptions(rotation=False))
    np.testing.assert_array_equal(fit.rotation, 0.0)
    assert np.isfinite(fit.covariance[:3, :3]).all()
    assert not fit.reason


def test_too_few_vertices_are_reported(top) -> None:
    fit = fit_rigid(top.points(lattice(3)), top)
    assert not fit.converged
    assert "fewer" in fit.reason


def test_a_fit_with_too_few_iterations_reports_it(top) -> None:
    points = top.points(lattice(500)) + 5.0
    fit = fit_rigid(points, top, options=RigidOptions(most_iterations=1))
    assert not fit.converged
    assert "still moving" in fit.reason


def test_the_centre_of_figure_of_a_moved_mesh_is_where_it_was_moved(top) -> None:
    mesh = IcqShape(_on(top, icq_directions(48)) + SHIFT).mesh()
    np.testing.assert_allclose(center_of_figure(mesh), SHIFT, atol=1e-9)
    np.testing.assert_allclose(truth_center(top), 0.0, atol=1e-6)
    found = measure_distances(mesh.vertices, top, SETTINGS, mesh)
    np.testing.assert_allclose(found.center_of_figure, SHIFT, atol=1e-6)
    assert np.isnan(measured(mesh.vertices, top).center_of_figure).all()


def _on(truth, directions):
    flat = directions.reshape(-1, 3)
    return (truth.radius(flat)[:, None] * flat).reshape(directions.shape)
