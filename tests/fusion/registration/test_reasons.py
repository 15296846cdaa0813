"""Weak geometry is reported, and its sigma covers the truth."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.registration.fit import FitOptions
from fusion.registration.fit.fit import fit_transform
from fusion.registration.fit.reasons import registration_reasons
from spcola.errors import NotObservableError
from spcola.math import lattice


def errors(fit, truth):
    """Errors of translation, rotation and scale over their sigmas (7,)."""
    scale, scale_sigma, rotation, rotation_sigma = fit.similarity_numbers()
    sigma = np.sqrt(np.diag(fit.covariance))
    return np.array(
        [
            *((fit.transform.translation - truth.translation) / sigma[:3]),
            *((rotation - truth.rotation_vector) / rotation_sigma),
            (scale - truth.scale) / scale_sigma,
        ]
    )


def upright(points, across, up):
    """Covariances (N, 3, 3) of matches with sigmas of `up` in height and `across` in position."""
    normal = points / np.linalg.norm(points, axis=1, keepdims=True)
    outer = normal[:, :, None] * normal[:, None, :]
    return across**2 * (np.eye(3) - outer) + up**2 * outer


def test_mapolas_all_over_a_body_give_no_reasons(scene):
    points = scene.body()
    assert registration_reasons(scene.registered(points, 1)) == []


def test_one_pole_cap_has_large_sigmas_that_cover_the_truth_and_is_reported(scene):
    points, pulls = scene.cap(25, share=0.01), []
    for seed in range(20):
        fit = scene.registered(points, seed)
        pulls.append(errors(fit, scene.planted))
    whole = scene.registered(scene.body(25), 0)
    sigma = np.sqrt(np.diag(fit.covariance) / np.diag(whole.covariance))
    assert np.all(sigma > 2.0), "compared with as many mapolas all over the body"
    assert np.all(np.std(pulls, axis=0) < 1.4)
    coverage, *weak, mixed = registration_reasons(fit)
    assert "of 20 equal regions" in coverage
    assert {text.split(":")[0] for text in weak} >= {"tx_m", "ty_m", "tz_m", "rx_rad", "ry_rad"}
    assert "tx_m and ry_rad (" in mixed
    assert "tz_m and scale (-" in mixed


def test_a_sphere_without_relief_determines_heights_only(scene):
    """Radius and centre are determined, the rotation is not."""
    points, pulls = scene.body(), []
    covariance = upright(points, 5.0, 0.02)
    for seed in range(10):
        fit = scene.registered(points, seed, covariance=covariance)
        pulls.append(errors(fit, scene.planted))
    assert np.all(np.sqrt(np.mean(np.square(pulls), axis=0)) < 1.6)
    sigma = np.sqrt(np.diag(fit.covariance))
    assert np.all(sigma[:3] < 0.05)
    assert sigma[6] < 3e-5
    weak = registration_reasons(fit)
    assert [text.split(":")[0] for text in weak] == ["rx_rad", "ry_rad", "rz_rad"]


def patch():
    """Mapola centres on a flat square of 40 m."""
    x, y = np.meshgrid(np.linspace(-20.0, 20.0, 6), np.linspace(-20.0, 20.0, 5))
    return np.stack([np.full(x.size, 245.0), x.ravel(), y.ravel()], axis=1)


def test_a_single_flat_scan_determines_height_and_tilt_only(scene):
    points = patch()
    flat = np.diag([0.02, 5.0, 5.0]) ** 2
    pulls = []
    for seed in range(20):
        fit = scene.registered(points, seed, covariance=flat, scans=1)
        pulls.append(errors(fit, scene.planted))
    assert np.all(np.sqrt(np.mean(np.square(pulls), axis=0)) < 1.6)
    sigma = np.sqrt(np.diag(fit.covariance))
    assert sigma[6] > 1e-2, "a flat patch of 40 m does not determine a scale"
    assert sigma[3] > 1e-2, "nor a turn about its normal"
    text = " ".join(registration_reasons(fit))
    for name in ("tx_m", "ty_m", "tz_m", "rx_rad", "scale"):
        assert f"{name}: weakly determined" in text
    assert "tx_m and scale (-" in text


def test_a_rotation_too_large_to_be_linear_is_called_undetermined(scene):
    claimed, drawn = np.diag([0.02, 30.0, 30.0]) ** 2, np.diag([0.02, 1.0, 1.0]) ** 2
    fit = scene.registered(patch(), 2, covariance=claimed, drawn=drawn, scans=1)
    texts = registration_reasons(fit)
    undetermined = [text for text in texts if "not determined at all" in text]
    assert [text.split(":")[0] for text in undetermined] == ["rx_rad"]


@pytest.mark.parametrize("model", ["rigid", "similarity", "affine"])
def test_two_mapolas_are_refused(scene, model):
    with pytest.raises(NotObservableError) as caught:
        scene.registered(scene.body(2), 1, model=model, scans=1)
    assert caught.value.parameters


def test_matches_by_chance_alone_have_the_sigma_of_chance():
    """Random matches are anywhere within the capture range."""
    generator = np.random.default_rng(1)
    points = 245.0 * lattice(30)
    moved = generator.uniform(-2.0, 2.0, points.shape)
    covariances = np.broadcast_to(1e-4 * np.eye(3), (30, 3, 3))
    options = FitOptions(center_sigma_m=0.05)
    fit = fit_transform(points, moved, covariances, np.zeros((30, 3, 0)), options=options)
    scale, sigma, _, _ = fit.similarity_numbers()
    assert fit.fit.sizes.independent > 1.0, "a uniform spread of 4 m"
    assert sigma > 5e-4
    assert abs(scale - 1.0) < 3 * sigma
