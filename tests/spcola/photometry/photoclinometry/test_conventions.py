"""Conventions of the albedo in the rounds of photoclinometry, and areas that are far brighter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from photographs import Painted
from solved_photographs import FEW_ROUNDS, photographs_of, slope_error, solved_flat

from spcola.math.robust import mad
from spcola.photometry.functions import lambert
from spcola.photometry.photoclinometry import AlbedoConvention, Outcome, PhotoclinometryOptions

DEFAULT = PhotoclinometryOptions(function=lambert)
HALF = AlbedoConvention.published(0.5)


class Spotted(Painted):
    """Waves of one albedo, with an area of another around a place."""

    def __init__(self, grid, ground, bright, radius):
        super().__init__(replace(grid, half_size=20))
        self.ground, self.bright, self.radius = ground, bright, radius

    def albedo(self, x, y):
        return np.where(np.hypot(x - 1.0, y + 2.0) < self.radius, self.bright, self.ground)

    def ratio(self, albedo):
        """Albedo of the inner area over that of the ground around, by its points."""
        steps = self.grid.offsets * self.grid.gsd
        x, y = np.meshgrid(steps, steps)
        away = np.hypot(x - 1.0, y + 2.0)
        return np.median(albedo[away < self.radius - 1.0]) / np.median(
            albedo[away > self.radius + 2.0]
        )


@pytest.fixture(scope="module")
def spotted(waves):
    return Spotted(waves.grid, 1.0, 3.0, 3.0)


@pytest.fixture(scope="module")
def spotted_photographs(spotted):
    return photographs_of(spotted, size=60)


def test_a_mean_of_a_half_halves_the_albedo_and_changes_nothing_else(painted, photographs):
    one, half = (
        solved_flat(painted, photographs, replace(FEW_ROUNDS, convention=convention))
        for convention in (AlbedoConvention.published(1.0), HALF)
    )
    assert one.maplet.albedo.mean() == pytest.approx(1.0, abs=1e-3)
    assert one.maplet.albedo.std() > 0.03
    np.testing.assert_allclose(half.maplet.albedo, 0.5 * one.maplet.albedo, rtol=1e-12)
    np.testing.assert_allclose(half.albedo_sigma, 0.5 * one.albedo_sigma, rtol=1e-12)
    np.testing.assert_array_equal(half.maplet.height, one.maplet.height)
    np.testing.assert_array_equal(half.maplet.sigma, one.maplet.sigma)


def test_a_mean_of_one_has_no_albedo_above_two(spotted, spotted_photographs):
    found = solved_flat(spotted, spotted_photographs, DEFAULT)
    albedo = found.maplet.albedo
    assert albedo.max() == 2.0
    assert np.sum(albedo == 2.0) > 50
    assert albedo.mean() == pytest.approx(1.0, abs=0.01)


def test_a_mean_of_a_half_has_no_albedo_above_that_of_a_map(waves):
    """The byte of a .MAP ends at 2.55: 5.1 times the mean."""
    spotted = Spotted(waves.grid, 0.35, 2.8, 2.0)
    images = photographs_of(spotted, size=60)
    wide = replace(DEFAULT, albedo_sigma=1.0, albedo_step_sigma=0.3)
    capped, free = (
        solved_flat(spotted, images, replace(wide, convention=convention)).maplet.albedo
        for convention in (HALF, AlbedoConvention(0.5, 100.0))
    )
    assert capped.max() == pytest.approx(2.55, rel=1e-12)
    assert np.sum(capped > 2.549) > 20
    assert capped.mean() == pytest.approx(0.5, abs=0.02)
    assert free.max() > 3.0


@pytest.mark.parametrize("mean", [1.0, 0.5])
def test_outliers_are_moved_to_the_range_of_robust_sigmas(painted, photographs, mean):
    def reach(range_sigmas):
        """Farthest of the albedos from their median, in robust sigmas; and how many are there."""
        options = replace(FEW_ROUNDS, convention=AlbedoConvention.published(mean, range_sigmas))
        albedo = solved_flat(painted, photographs, options).maplet.albedo[1:-1, 1:-1]
        away = np.abs(albedo - np.median(albedo)) / mad(albedo)
        return away.max(), np.mean(away > 0.99 * away.max())

    farthest, share = reach(1.0)
    # Points are means of four cells, which scatter by a little less.
    assert farthest == pytest.approx(1.0, abs=0.05)
    assert share > 0.1
    farthest, share = reach(np.inf)
    assert farthest > 1.8
    assert share < 0.02


@pytest.mark.parametrize(
    ("ground", "area", "wrong_ratio", "wrong_slopes"),
    [
        (1.0, 0.1, 0.02, 0.025),
        (1.0, 2.0, 0.02, 0.01),
        (1.0, 3.0, 0.02, 0.013),
        (0.5, 2.0, 0.05, 0.013),
    ],
)
def test_an_area_of_another_albedo_is_found_by_default(
    waves, ground, area, wrong_ratio, wrong_slopes
):
    """The prior of the albedo has Cauchy's weight; what is farther off starts from the images'."""
    spotted = Spotted(waves.grid, ground, area, 3.0)
    options = replace(DEFAULT, convention=HALF, rounds=24)
    found = solved_flat(spotted, photographs_of(spotted, size=60), options)
    assert found.outcome is Outcome.CONVERGED
    assert np.isnan(found.left_over)
    assert spotted.ratio(found.maplet.albedo) == pytest.approx(area / ground, rel=wrong_ratio)
    assert slope_error(spotted, found) < wrong_slopes


@pytest.mark.parametrize("rounds", [12, 60])
def test_an_area_beyond_the_largest_albedo_of_the_convention_is_stated(
    spotted, spotted_photographs, rounds
):
    """With more rounds it ends as converged, and no residual of an image shows it."""
    options = replace(DEFAULT, rounds=rounds)
    assert solved_flat(spotted, spotted_photographs, options).left_over > 0.3
