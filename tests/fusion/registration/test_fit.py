from __future__ import annotations

import numpy as np
import pytest

from fusion.registration.fit import FitOptions, ScanErrorPatterns, share_matrix
from fusion.registration.fit.fit import fit_transform
from fusion.registration.fit.significance import strain_departure
from fusion.registration.transform import transform_partials
from spcola.errors import NotObservableError
from spcola.math import Affine, Similarity


def centers(generator, count=80, radius=250.0):
    directions = generator.normal(size=(count, 3))
    return radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)


def planted():
    return Similarity.from_rotation_vector(
        np.radians([0.002, -0.003, 0.011]), [0.05, -0.04, 0.06], 1.0005, "spc", "lidar"
    )


def fit(points, truth, generator, *, sigma=0.01, scan_sigma=0.0, scans=12, model="similarity"):
    shares = np.eye(scans)[np.arange(len(points)) % scans]
    shared = scan_sigma * generator.normal(size=(scans, 3))
    moved = truth.apply(points) - points
    moved = moved + shares @ shared + sigma * generator.normal(size=points.shape)
    covariances = np.broadcast_to(sigma**2 * np.eye(3), (len(points), 3, 3))
    effects = scan_effects(shares, points)
    return fit_transform(points, moved, covariances, effects, options=FitOptions(model=model))


def scan_effects(shares, points, sigma=0.05):
    names = [f"scan{number}" for number in range(shares.shape[1])]
    return ScanErrorPatterns.independent(names, sigma).at(shares, points)


def test_planted_similarity_is_recovered_exactly_without_noise():
    generator = np.random.default_rng(1)
    points = centers(generator) + np.array([300.0, -50.0, 20.0])
    truth = planted()
    result = fit(points, truth, generator, sigma=1e-9)
    similarity = result.similarity
    assert similarity.scale == pytest.approx(truth.scale, abs=1e-10)
    np.testing.assert_allclose(similarity.rotation_vector, truth.rotation_vector, atol=1e-10)
    np.testing.assert_allclose(similarity.translation, truth.translation, atol=1e-7)
    assert (result.transform.target, result.transform.source) == ("spc", "lidar")


def test_pulls_of_all_parameters_are_of_unit_width_with_misplaced_scans():
    truth, pulls = planted(), []
    for seed in range(40):
        generator = np.random.default_rng(seed)
        result = fit(centers(generator), truth, generator, sigma=0.02, scan_sigma=0.05)
        scale, scale_sigma, rotation, rotation_sigma = result.similarity_numbers()
        sigma = np.sqrt(np.diag(result.covariance))
        pulls.append(
            [
                *((result.similarity.translation - truth.translation) / sigma[:3]),
                *((rotation - truth.rotation_vector) / rotation_sigma),
                (scale - truth.scale) / scale_sigma,
            ]
        )
    width = np.std(pulls, axis=0)
    assert np.all((width > 0.7) & (width < 1.35)), width


@pytest.mark.parametrize("model", ["rigid", "similarity", "affine"])
def test_partials_match_finite_differences(model):
    generator = np.random.default_rng(3)
    points, center = centers(generator, 5), np.array([10.0, 20.0, -5.0])
    base = Similarity.from_rotation_vector(
        [0.3, -0.2, 0.5], [1.0, 2.0, 3.0], 1.0 if model != "similarity" else 1.2
    )
    partials = transform_partials(model, base, points, center)
    step = 1e-6
    for column in range(partials.shape[2]):
        moved = []
        for sign in (1.0, -1.0):
            delta = np.zeros(partials.shape[2])
            delta[column] = sign * step
            image = base.apply(center) + delta[:3]
            if model == "affine":
                matrix = base.scale * base.rotation + delta[3:].reshape(3, 3)
            else:
                turn = Similarity.from_rotation_vector(delta[3:6]).rotation
                scale = base.scale + (delta[6] if model == "similarity" else 0.0)
                matrix = scale * turn @ base.rotation
            moved.append(image + (points - center) @ matrix.T)
        numeric = (moved[0] - moved[1]) / (2 * step)
        np.testing.assert_allclose(partials[:, :, column], numeric, atol=1e-6)


def test_affine_separates_shear_from_none():
    generator = np.random.default_rng(4)
    points = centers(generator)
    sheared = Affine(np.eye(3) + 1e-3 * np.array([[0, 1, 0], [1, 0, 0], [0, 0, 0]]), np.zeros(3))
    found = strain_departure(fit(points, sheared, generator, model="affine"))
    assert found.estimate[2] == pytest.approx(1e-3, abs=4 * found.sigma[2])
    assert found.estimate[2] > 10 * found.sigma[2]
    found = strain_departure(fit(points, planted(), generator, model="affine"))
    assert np.all(np.abs(found.estimate) < 4 * found.sigma)


def test_a_misplaced_mapola_is_rejected():
    generator = np.random.default_rng(5)
    points = centers(generator)
    truth = planted()
    moved = truth.apply(points) - points + 0.01 * generator.normal(size=points.shape)
    moved[7] += [2.0, 0.0, 0.0]
    shares = np.eye(10)[np.arange(len(points)) % 10]
    covariances = np.broadcast_to(1e-4 * np.eye(3), (len(points), 3, 3))
    result = fit_transform(points, moved, covariances, scan_effects(shares, points))
    assert np.flatnonzero(~result.fit.used).tolist() == [7]
    assert np.all(result.residual_std < 0.02)


def test_a_small_region_gets_a_sigma_that_covers_its_error():
    truth = planted()
    for seed in range(5):
        generator = np.random.default_rng(seed)
        points = np.array([250.0, 0.0, 0.0]) + 15.0 * generator.normal(size=(25, 3)) * [0.1, 1, 1]
        result = fit(points, truth, generator, sigma=0.02, scan_sigma=0.05)
        scale, sigma, _, _ = result.similarity_numbers()
        assert sigma > 2e-4, "a patch of 30 m cannot determine the scale to a hundred ppm"
        assert abs(scale - truth.scale) < 4 * sigma


@pytest.mark.parametrize(
    ("points", "free"),
    [
        ([[250.0, 0, 0], [0, 250.0, 0]], "rx_rad"),
        ([[250.0, 0, 0], [250.0, 10, 0], [250.0, 20, 0], [250.0, 30, 0]], "ry_rad"),
        ([[250.0, 0, 0]] * 4, "scale"),
    ],
)
def test_too_few_or_badly_placed_mapolas_are_refused(points, free):
    points = np.array(points)
    shares = np.eye(len(points))
    covariances = np.broadcast_to(1e-4 * np.eye(3), (len(points), 3, 3))
    with pytest.raises(NotObservableError) as caught:
        fit_transform(points, np.zeros_like(points), covariances, scan_effects(shares, points))
    assert free in caught.value.parameters


def test_rigid_fixes_the_scale_at_one():
    generator = np.random.default_rng(6)
    result = fit(centers(generator), planted(), generator, model="rigid")
    scale, sigma, _, _ = result.similarity_numbers()
    assert (scale, sigma) == (pytest.approx(1.0, abs=1e-12), 0.0)


def test_positions_are_less_certain_away_from_the_mapolas():
    generator = np.random.default_rng(7)
    result = fit(centers(generator), planted(), generator)
    places = np.array([[0.0, 0, 0], [1000.0, 0, 0]])
    unknown = scan_effects(np.zeros((2, 12)), places)
    near, far = result.position_covariance(places, unknown)
    assert np.trace(far) > 4 * np.trace(near)


def test_an_error_that_all_scans_share_is_in_the_transform_and_not_in_the_positions():
    """It is not separable from T: T is as uncertain, registered positions are not."""
    generator = np.random.default_rng(8)
    points = centers(generator)
    shares = np.full((len(points), 1), 1.0)
    covariances = np.broadcast_to(1e-6 * np.eye(3), (len(points), 3, 3))
    effects = scan_effects(shares, points, sigma=0.05)
    moved = 0.001 * generator.normal(size=points.shape)
    options = FitOptions(center_sigma_m=0.001)
    result = fit_transform(points, moved, covariances, effects, options=options)
    assert np.sqrt(np.diag(result.covariance)[:3]).min() > 0.01
    registered = result.position_covariance(points, effects)
    assert np.sqrt(np.einsum("nii->n", registered)).max() < 0.002


def test_a_turned_scan_displaces_its_far_end():
    """Modes of rotation reach a mapola by its arm from the scan's centre."""
    modes = np.zeros((6, 1))
    modes[5, 0] = 1e-3
    scans = ScanErrorPatterns(("one",), np.array([[100.0, 0.0, 0.0]]), modes)
    effect = scans.at(np.ones((1, 1)), np.array([[150.0, 0.0, 0.0]]))
    assert effect[0, :, 0] == pytest.approx([0.0, 0.05, 0.0], abs=1e-15)


def test_shares_are_put_in_the_order_of_the_scans():
    matrix = share_matrix([{"b": 0.25, "a": 0.75}, {"b": 1.0}], ["a", "b", "c"])
    assert matrix.tolist() == [[0.75, 0.25, 0.0], [0.0, 1.0, 0.0]]
