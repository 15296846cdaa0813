"""The prior of the albedo: a field of cells, each like its neighbours."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.photometry.photoclinometry.albedo_equations import albedo_information
from spcola.photometry.photoclinometry.albedo_prior import AlbedoPrior
from spcola.photometry.photoclinometry.image_equations import Sums

SHAPE = (9, 12)
PRIOR = AlbedoPrior(sigma=0.2, step_sigma=0.04)


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def weighted(departure, sigma):
    """Information of a sigma with Cauchy's weight: half of it at two sigmas."""
    return sigma**-2 / (1.0 + (departure / (2.0 * sigma)) ** 2)


def field_information(prior, albedo):
    """The information of all cells about 1, from the differences of all pairs of neighbours."""
    places, values = np.argwhere(np.ones(SHAPE)), albedo.ravel()
    matrix = np.diag(weighted(values - 1.0, prior.sigma))
    for a, one in enumerate(places):
        for b, other in enumerate(places[:a]):
            if np.abs(one - other).max() == 1:
                pair = np.zeros(len(places))
                pair[a], pair[b] = 1.0, -1.0
                sigma = np.sqrt(8.0) * prior.step_sigma
                matrix += weighted(values[a] - values[b], sigma) * np.outer(pair, pair)
    return matrix


def observed(rng):
    """Albedo that images show, and their information on it; none in a corner."""
    information = rng.uniform(200.0, 5000.0, SHAPE)
    information[:3, :4] = 0.0
    return 1.0 + 0.1 * rng.normal(size=SHAPE), information


def test_cells_solved_again_and_again_are_the_solution_of_all_at_once(rng):
    seen, information = observed(rng)
    albedo = np.ones(SHAPE)
    for _ in range(600):
        prior = PRIOR.about(albedo)
        right = information * (seen - albedo) + prior.right
        albedo = albedo + right / (information + prior.information)
    matrix = field_information(PRIOR, albedo)
    right = (information * seen).ravel() + matrix @ np.ones(albedo.size)
    whole = np.linalg.solve(matrix + np.diag(information.ravel()), right)
    np.testing.assert_allclose(albedo.ravel(), whole, atol=1e-9)


def test_the_prior_among_neighbours_has_the_variance_of_the_field(rng):
    seen, information = observed(rng)
    prior = PRIOR.among_neighbours(information, seen)
    covariance = np.linalg.inv(field_information(PRIOR, seen) + np.diag(information.ravel()))
    variance = 1.0 / (information + prior.information)
    np.testing.assert_allclose(variance.ravel(), np.diag(covariance), rtol=1e-9)
    # The surer the neighbours are, the more they determine: at most as if they were known.
    least = AlbedoPrior(PRIOR.sigma).about(seen).information
    most = PRIOR.about(seen).information
    assert np.all(least < prior.information)
    assert np.all(prior.information < most)
    surest = PRIOR.among_neighbours(np.full(SHAPE, 1e9), seen)
    np.testing.assert_allclose(surest.information, most, rtol=1e-3)


def test_far_from_what_is_expected_the_pull_falls():
    """A border of several times the albedo does not draw both sides to each other."""
    albedo = np.ones(SHAPE)
    albedo[:, 6:] = 3.0
    prior = PRIOR.about(albedo)
    pair = 2.0 * weighted(2.0, np.sqrt(8.0) * PRIOR.step_sigma)
    np.testing.assert_allclose(prior.right[1:-1, 5], 3.0 * pair)
    np.testing.assert_allclose(prior.right[:, 11], -2.0 * weighted(2.0, PRIOR.sigma))
    # A fiftieth of what a Gaussian prior would draw with.
    assert pair < 2.0 / (8.0 * PRIOR.step_sigma**2) / 50.0


def test_the_information_of_images_on_the_albedo_leaves_slopes_free(rng):
    """That of the Schur complement of the slopes, with their prior, in each cell."""
    derivatives = rng.normal(size=(*SHAPE, 5, 4)) * [20.0, 30.0, 1.0, 40.0]
    # Images that show one cell in one light only: slope and albedo cannot be separated.
    derivatives[0, 0] = derivatives[0, 0, :1]
    normal = np.einsum("...ka,...kb->...ab", derivatives, derivatives)
    sums = Sums.empty(5, SHAPE)
    for place, (a, b) in enumerate(zip(*np.triu_indices(4), strict=True)):
        sums.own[place] = normal[..., a, b]
    found = albedo_information(sums, 0.3)
    for i, j in np.ndindex(SHAPE):
        slopes = normal[i, j][:2, :2] + 0.3**-2 * np.eye(2)
        mixed = normal[i, j][:2, 3]
        expected = normal[i, j][3, 3] - mixed @ np.linalg.solve(slopes, mixed)
        assert found[i, j] == pytest.approx(expected, rel=1e-9)
    assert found[0, 0] < 0.1 * normal[0, 0, 3, 3]


def test_without_steps_cells_are_independent(rng):
    seen, information = observed(rng)
    alone, expected = AlbedoPrior(0.2), weighted(seen - 1.0, 0.2)
    for prior in (alone.about(seen), alone.among_neighbours(information, seen)):
        np.testing.assert_allclose(prior.information, expected)
    np.testing.assert_allclose(alone.about(seen).right, expected * (1.0 - seen))


def test_even_albedo_is_drawn_to_its_mean_alone():
    prior = PRIOR.about(np.full(SHAPE, 1.3))
    np.testing.assert_allclose(prior.right, -0.3 * weighted(0.3, 0.2))
