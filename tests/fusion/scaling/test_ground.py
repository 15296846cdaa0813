from __future__ import annotations

import numpy as np
import pytest

from fusion.scaling.fit import estimate_scale
from fusion.scaling.fit.ground import common_reach, correlated_patterns, patch_patterns
from fusion.scaling.fit.observation import ScaleObservations

RADIUS = 245.0
CENTER = np.array([0.1, -0.05, 0.02])
EPSILON = 2e-4
NOISE = 0.1


def heights(generator, points, reach):
    """Heights of unit variance at points, correlated by exp(−d/a)."""
    wave = generator.normal(size=(400, 3)) / np.abs(generator.normal(size=(400, 1))) / reach
    phase = generator.uniform(0.0, 2.0 * np.pi, 400)
    return np.sqrt(2.0 / 400) * np.cos(points @ wave.T + phase).sum(axis=1)


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def on_rasters(generator, *, count=50, side=2, step=1.0):
    """Normals (N, 3) of `count` rasters of side² shots, `step` metres apart, all over a sphere."""
    middle = unit(generator.normal(size=(count, 3)))
    first = unit(np.cross(middle, unit(generator.normal(size=(count, 3)))))
    second = np.cross(middle, first)
    u, v = (each.ravel() * step / RADIUS for each in np.meshgrid(*[np.arange(side)] * 2))
    offsets = u[:, None, None] * first + v[:, None, None] * second
    return unit(middle + offsets).transpose(1, 0, 2).reshape(-1, 3)


def shots(generator, normal, *, relief, reach=6.0):
    """Shots of an independent trajectory at a sphere with SPC height errors of `relief` metres."""
    beam = -unit(normal + 0.1 * generator.normal(size=3))
    day = tuple(f"2019-03-{1 + n % 5:02d}" for n in range(len(normal)))
    point = RADIUS * normal
    shift = EPSILON * point + CENTER + 0.03 * generator.normal() * beam
    shift = shift - relief * heights(generator, point, reach)[:, None] * normal
    value = np.sum(normal * shift, axis=1) / np.sum(normal * beam, axis=1)
    value += NOISE * generator.normal(size=len(value))
    return ScaleObservations(
        kind="shots",
        label=("scan",) * len(normal),
        day=day,
        value=value[:, None],
        covariance=np.full((len(normal), 1, 1), NOISE**2),
        point=point,
        beam=beam,
        range=np.full(len(normal), 1000.0),
        normal=normal,
        local_time_h=np.full(len(normal), np.nan),
        shares=np.ones((len(normal), 1)),
        trajectory="reference",
    )


def test_dense_shots_on_rough_ground_have_true_sigmas():
    pulls, found = [], []
    for seed in range(40):
        generator = np.random.default_rng(seed)
        estimate = estimate_scale(shots(generator, on_rasters(generator), relief=0.5))
        error = estimate.fit.estimate[:4] - [EPSILON, *CENTER]
        pulls.append(error / estimate.fit.sigma[:4])
        found.append(
            (estimate.ground.reach_m, estimate.ground.sigma_m * estimate.fit.sizes.shared[2])
        )
    scatter = np.array([np.std(pulls, axis=0)[0], np.std(np.array(pulls)[:, 1:])])
    assert np.all((scatter > 0.8) & (scatter < 1.25)), scatter
    reach, sigma = np.median(found, axis=0)
    assert 3.0 < reach < 12.0
    assert sigma == pytest.approx(0.5, rel=0.25)


def test_shots_further_apart_than_errors_reach_are_independent():
    # Errors of the ground are errors of single shots then, and their sigmas are right without it.
    pulls = []
    for seed in range(40):
        generator = np.random.default_rng(seed)
        normal = unit(generator.normal(size=(150, 3)))
        estimate = estimate_scale(shots(generator, normal, relief=0.5, reach=1.0))
        assert estimate.ground is None
        error = estimate.fit.estimate[:4] - [EPSILON, *CENTER]
        pulls.append(error / estimate.fit.sigma[:4])
    scatter = np.array([np.std(pulls, axis=0)[0], np.std(np.array(pulls)[:, 1:])])
    assert np.all((scatter > 0.75) & (scatter < 1.25)), scatter


def test_the_reach_of_errors_is_found():
    generator = np.random.default_rng(5)
    points = np.stack([*generator.uniform(0.0, 200.0, (2, 2000)), np.zeros(2000)], axis=1)
    rough = heights(generator, points, 8.0) + generator.normal(size=2000)
    reach, share = common_reach(points, rough / np.std(rough), furthest=50.0)
    assert share == pytest.approx(0.5, abs=0.15)
    assert reach == pytest.approx(8.0, rel=0.4)
    white = generator.normal(size=2000)
    assert common_reach(points, white, furthest=50.0) == (0.0, 0.0)
    assert common_reach(points[:3], white[:3], furthest=50.0) == (0.0, 0.0)


def test_shots_on_one_point_share_one_pattern_and_lone_shots_none():
    lone = np.array([[1e3 * n, 0.0, 0.0] for n in range(1, 4)])
    together = np.zeros((4, 3))
    patterns = correlated_patterns(np.concatenate([together, lone]), 5.0)
    assert patterns.shape == (7, 1)
    np.testing.assert_allclose(patterns[:4] ** 2, 1.0, atol=1e-9)
    np.testing.assert_allclose(patterns[4:], 0.0, atol=1e-9)


def test_patterns_carry_the_correlation_of_near_shots():
    points = np.random.default_rng(6).uniform(0.0, 10.0, (60, 3)) * [1.0, 1.0, 0.0]
    patterns = correlated_patterns(points, 10.0)
    away = np.linalg.norm(points[:, None] - points[None], axis=2)
    expected = np.exp(-away / 10.0)
    far = away > 1.0
    assert np.sqrt(np.mean((patterns @ patterns.T - expected)[far] ** 2)) < 0.1
    assert patterns.shape[1] < 15


def test_wide_ground_is_parted_into_few_patches_that_keep_their_variance():
    generator = np.random.default_rng(7)
    points = RADIUS * unit(generator.normal(size=(1500, 3)))
    patterns = patch_patterns(points, 5.0)
    assert 40 < patterns.shape[1] <= 160
    np.testing.assert_array_equal(np.count_nonzero(patterns, axis=1), 1)
    # Of errors that reach 5 m a patch of some 80 m keeps little but what single shots are.
    means, expected = [], []
    for column in patterns.T:
        inside = column > 0
        means.append(np.sum(column[inside] ** 2) / np.count_nonzero(inside))
        away = np.linalg.norm(points[inside][:, None] - points[inside][None], axis=2)
        expected.append(np.exp(-away / 5.0).mean())
    np.testing.assert_allclose(means, expected, rtol=1e-9)
    assert np.median(means) < 0.25
