from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from fusion.registration.fit.significance import departures_json, scale_departure, strain_departure
from spcola.math import Similarity

STRAIN = np.array([[0.0, 1e-3, 0.0], [1e-3, 0.0, 0.0], [0.0, 0.0, -6e-4]])


@pytest.mark.parametrize("model", ["rigid", "similarity"])
def test_without_a_strain_the_test_is_chi_square(scene, model):
    """The p-values are even over 0 … 1, and the pulls of unit width."""
    scale = 1.0 if model == "rigid" else 1.0005
    truth = Similarity(scene.planted.rotation, scene.planted.translation, scale, "spc", "lidar")
    points, pulls, chances = scene.body(), [], []
    for seed in range(40):
        fit = scene.registered(points, seed, truth=truth, model=model)
        found = strain_departure(fit)
        pulls.append(found.estimate / found.sigma)
        chances.append(found.test()["p_value"])
        if model == "rigid":
            chances.append(scale_departure(fit).test()["p_value"])
    assert np.all(np.abs(np.std(pulls, axis=0) - 1.0) < 0.3)
    assert stats.kstest(chances, "uniform").pvalue > 0.05


@pytest.mark.parametrize("model", ["rigid", "similarity", "affine"])
def test_a_planted_strain_is_found_with_every_model(scene, model):
    points = scene.body()
    fit = scene.registered(points, 1, truth=scene.strained(scene.planted, STRAIN), model=model)
    found = strain_departure(fit)
    planted = np.array([2e-4, 2e-4, 1e-3, 0.0, 0.0])
    assert np.all(np.abs(found.estimate - planted) < 3 * found.sigma)
    test = found.test()
    assert (test["degrees_of_freedom"], test["reason"]) == (5, "")
    assert test["p_value"] < 1e-12


def test_strain_has_the_axes_of_the_lidar_frame_however_far_the_frames_are_turned(scene):
    turned = Similarity.from_rotation_vector([0.3, -0.8, 1.1], [1.0, 2.0, 3.0], 1.2, "spc", "lidar")
    points = scene.body()
    for model in ("similarity", "affine"):
        fit = scene.registered(points, 2, truth=scene.strained(turned, STRAIN), model=model)
        found = strain_departure(fit)
        assert np.all(np.abs(found.estimate - [2e-4, 2e-4, 1e-3, 0.0, 0.0]) < 3 * found.sigma)


def test_a_rigid_fit_tests_the_scale_that_it_lacks(scene):
    points = scene.body()
    found = scale_departure(scene.registered(points, 3, model="rigid"))
    assert found.estimate[0] == pytest.approx(5e-4, abs=3 * found.sigma[0])
    assert found.test()["p_value"] < 1e-6
    for model in ("similarity", "affine"):
        fitted = scale_departure(scene.registered(points, 3, model=model))
        assert fitted.estimate[0] == pytest.approx(5e-4, abs=3 * fitted.sigma[0])


def test_the_score_test_is_the_affine_fit_where_error_sizes_are_known(scene):
    """With sizes that the strain does not move, the score test equals the fit."""
    points = scene.body()
    separate = strain_departure(scene.registered(points, 4))
    fitted = strain_departure(scene.registered(points, 4, model="affine"))
    np.testing.assert_allclose(separate.estimate, fitted.estimate, atol=0.2 * fitted.sigma.min())
    np.testing.assert_allclose(separate.sigma, fitted.sigma, rtol=0.1)


def test_a_cap_does_not_determine_strain_and_its_sigma_is_large(scene):
    points = scene.cap()
    found = strain_departure(scene.registered(points, 5))
    whole = strain_departure(scene.registered(scene.body(25), 5))
    assert found.sigma.max() > 1.5 * whole.sigma.max()
    assert found.test()["p_value"] > 0.01


def test_what_cannot_be_observed_is_null_with_a_reason(scene):
    few = scene.body(3)
    content = departures_json(scene.registered(few, 6, scans=2))
    assert np.isnan(content["strain"]["p_value"])
    assert content["strain"]["reason"] == "3 mapolas give 9 numbers for 12 parameters"
    assert content["scale"]["reason"] == ""
    ring = 245.0 * np.array([[np.cos(a), np.sin(a), 0.0] for a in np.linspace(0.0, 5.5, 12)])
    flat = departures_json(scene.registered(ring, 6))
    assert np.all(np.isnan(flat["strain"]["strain"]))
    assert "do not determine" in flat["strain"]["reason"]
