from __future__ import annotations

import numpy as np
import pytest

from fusion.registration.fit.fixed_weights import FixedWeightEquations
from fusion.registration.fit.stability import (
    REGIONS,
    block_bootstrap,
    leave_one_region_out,
    region_numbers,
    stability_json,
    suspects,
)
from fusion.registration.transform.parameters import origin_jacobian
from spcola.math import lattice


def test_regions_are_of_about_equal_area():
    count = np.bincount(region_numbers(lattice(20_000)), minlength=REGIONS)
    assert count.min() > 0.85 * 1000
    assert count.max() < 1.15 * 1000


def test_solving_again_with_everything_changes_nothing(scene):
    points = scene.body()
    fit = scene.registered(points, 1)
    equations = FixedWeightEquations.of(fit, fit.model)
    again = equations.refit(np.ones(len(equations.value), dtype=bool))
    origin = origin_jacobian(fit.model, fit.similarity, fit.center)
    sigma = np.sqrt(np.diag(fit.covariance))
    assert np.all(np.abs(origin @ again.change) < 1e-3 * sigma)
    np.testing.assert_allclose(
        origin @ again.covariance @ origin.T / np.outer(sigma, sigma),
        fit.covariance / np.outer(sigma, sigma),
        atol=1e-4,
    )


def test_changes_by_leaving_regions_out_have_the_sigma_that_is_stated(scene):
    points, pulls, alarms = scene.body(), [], 0
    for seed in range(12):
        regions = leave_one_region_out(scene.registered(points, seed))
        pulls += [region.change / region.sigma for region in regions]
        alarms += len(suspects(regions))
        assert sum(region.count for region in regions) == len(points)
    assert np.all(np.abs(np.std(pulls, axis=0) - 1.0) < 0.2), np.std(pulls, axis=0)
    assert alarms <= 1


def test_a_region_that_lies_elsewhere_is_named(scene):
    """Ten mapolas that SPC has 8 cm off, too little to reject each of them."""
    points = scene.body(200)
    inside = region_numbers(points) == 7
    extra = 0.08 * np.outer(inside, [0.0, 1.0, 0.0])
    fit = scene.registered(points, 2, extra=extra, sigma=0.02, scan_sigma=0.02)
    assert np.all(fit.fit.used[inside])
    named = suspects(leave_one_region_out(fit))
    assert [region.direction.tolist() for region in named] == [lattice(REGIONS)[7].tolist()]
    content = stability_json(fit)
    assert content["suspect_regions"] == [named[0].name]
    assert named[0].p_value < 1e-4


def test_a_region_without_which_nothing_is_left_has_a_reason(scene):
    points = scene.cap(8, share=0.002)
    regions = leave_one_region_out(scene.registered(points, 3, scans=3))
    assert len(regions) == 1
    assert regions[0].reason.startswith("without it the observations do not determine")
    assert np.all(np.isnan(regions[0].change))
    assert not suspects(regions)


def test_the_bootstrap_gives_the_formal_sigma_where_errors_are_independent(scene):
    points, ratios = scene.body(300), []
    for seed in range(6):
        fit = scene.registered(points, seed, scan_sigma=0.0)
        found = block_bootstrap(fit)
        ratios.append(found.sigma / np.sqrt(np.diag(fit.covariance)))
        assert (found.samples, found.reason) == (200, "")
    # The translation has a share of what all scans could be off by, which no drawing shows.
    np.testing.assert_allclose(np.median(ratios, axis=0)[3:], 1.0, atol=0.15)


def test_the_bootstrap_includes_errors_that_neighbours_share_and_the_model_does_not(scene):
    """Errors shared by a quarter of a region count as independent in the formal sigma."""
    points = scene.body(600)
    nearest = np.argmax(points @ lattice(60).T, axis=1)
    extra = 0.05 * np.random.default_rng(4).normal(size=(60, 3))[nearest]
    fit = scene.registered(points, 4, extra=extra, scan_sigma=0.0)
    ratio = block_bootstrap(fit).sigma / np.sqrt(np.diag(fit.covariance))
    assert np.median(ratio) > 1.6


def test_the_bootstrap_is_reproducible_and_gives_a_reason_if_blocks_are_too_few(scene):
    points = scene.body()
    fit = scene.registered(points, 5)
    first, again = (block_bootstrap(fit, samples=40, seed=1) for _ in range(2))
    assert first.sigma.tolist() == again.sigma.tolist()
    few = scene.body(12)
    none = block_bootstrap(scene.registered(few, 5, scans=3))
    assert np.all(np.isnan(none.sigma))
    assert none.reason == "12 mapolas make too few blocks of neighbours"


@pytest.mark.parametrize("model", ["rigid", "affine"])
def test_every_model_has_its_stability(scene, model):
    points = scene.body()
    content = stability_json(scene.registered(points, 6, model=model))
    assert len(content["bootstrap_sigma"]) == len(content["parameters"])
    assert len(content["regions"]) == REGIONS
