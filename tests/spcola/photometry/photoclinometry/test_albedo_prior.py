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


def field_information(prior):
    """The information of all cells about 1, from the differences of all pairs of neighbours."""
    places = np.argwhere(np.ones(SHAPE))
    matrix = prior.sigma**-2 * np.eye(len(places))
    for a, one in enumerate(places):
        for b, other in enumerate(places[:a]):
            if np.abs(one - other).max() == 1:
                pair = np.zeros(len(places))
                pair[a], pair[b] = 1.0, -1.0
                matrix += prior.step_sigma**-2 / 8.0 * np.outer(pair, pair)
    return matrix


def observed(rng):
    """Albedo that images show, and their information on it; none in a corner."""
    information = rng.uniform(200.0, 5000.0, SHAPE)
    information[:3, :4] = 0.0
    return 1.0 + 0.1 * rng.normal(size=SHAPE), information


def test_cells_solved_again_and_again_are_the_solution_of_all_at_once(rng):
    seen, information = observed(rng)
    albedo = np.ones(SHAPE)
    for _ in range(400):
        prior = PRIOR.about(albedo)
        right = information * (seen - albedo) + prior.right
        albedo = albedo + right / (information + prior.information)
    matrix = field_information(PRIOR)
    right = (information * seen).ravel() + matrix @ np.ones(albedo.size)
    whole = np.linalg.solve(matrix + np.diag(information.ravel()), right)
    np.testing.assert_allclose(albedo.ravel(), whole, atol=1e-9)


def test_the_prior_among_neighbours_has_the_variance_of_the_field(rng):
    _, information = observed(rng)
    prior = PRIOR.among_neighbours(information)
    covariance = np.linalg.inv(field_information(PRIOR) + np.diag(information.ravel()))
    variance = 1.0 / (information + prior.information)
    np.testing.assert_allclose(variance.ravel(), np.diag(covariance), rtol=1e-9)
    # The surer the neighbours are, the more they determine: at most as if they were known.
    least = AlbedoPrior(PRIOR.sigma).about(np.ones(SHAPE)).information
    most = PRIOR.about(np.ones(SHAPE)).information
    assert np.all(least < prior.information)
    assert np.all(prior.information < most)
    surest = PRIOR.among_neighbours(np.full(SHAPE, 1e9))
    np.testing.assert_allclose(surest.information, most, rtol=1e-3)


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
    alone = AlbedoPrior(0.2)
    for prior in (alone.about(seen), alone.among_neighbours(information)):
        np.testing.assert_allclose(prior.information, 25.0)
    np.testing.assert_allclose(alone.about(seen).right, 25.0 * (1.0 - seen))


def test_even_albedo_is_drawn_to_its_mean_alone():
    prior = PRIOR.about(np.full(SHAPE, 1.3))
    np.testing.assert_allclose(prior.right, -0.3 * 25.0)
