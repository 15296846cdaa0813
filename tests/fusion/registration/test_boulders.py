"""Boulders that SPC shortens must not bias the scale."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from fusion.registration.fit import FitOptions
from fusion.registration.fit.fit import fit_transform
from fusion.surfacematch import Match, Surface, match_surfaces
from spcola.grids import MapletGrid
from spcola.math import lattice

RADIUS, GSD, HALF = 245.0, 0.35, 32
SCALE = 1.0004


def ground(generator, correlation):
    """Random ground (2q+1, 2q+1) of unit variance."""
    side = 2 * HALF + 1
    rough = ndimage.gaussian_filter(generator.normal(size=(side, side)), correlation, mode="wrap")
    return rough / rough.std()


def boulders(generator, count=12):
    """Heights of half ellipsoids of 0.6 to 2.5 m across, half as high."""
    x = GSD * (np.arange(2 * HALF + 1) - HALF)
    height = np.zeros((len(x), len(x)))
    for _ in range(count):
        radius = 0.6 * (1.0 - generator.random() * (1.0 - (0.6 / 2.5) ** 2)) ** -0.5
        cx, cy = generator.uniform(-HALF * GSD, HALF * GSD, 2)
        square = np.add.outer((x - cy) ** 2, (x - cx) ** 2) / radius**2
        height = np.maximum(height, radius * np.sqrt(np.maximum(1.0 - square, 0.0)))
    return height


def terrain_match(number, direction, generator) -> tuple[Match, float]:
    """Match a terrain whose boulders SPC has at 50 to 70 % of their height; their mean too.

    SPC has correlated errors of 4 cm, the lidar independent ones of 1 cm.
    """
    grid = MapletGrid.facing(RADIUS * direction, direction, GSD, HALF)
    base, stones = 0.3 * ground(generator, 3.0), boulders(generator)
    lidar = base + stones + 0.01 * generator.normal(size=base.shape)
    kept = generator.uniform(0.5, 0.7)
    raised = RADIUS * (SCALE - 1.0)
    spc = base + kept * stones + 0.04 * ground(generator, 2.0) + raised
    match = match_surfaces(f"M{number}", grid, Surface(lidar), Surface(spc))
    return match, float(np.mean(spc - lidar))


@pytest.fixture(scope="module")
def bodies():
    """Three bodies of sixty terrains: the matches, and the mean height difference of each."""
    found = []
    for seed in range(3):
        generator = np.random.default_rng(seed)
        both = [terrain_match(k, direction, generator) for k, direction in enumerate(lattice(60))]
        found.append(([match for match, _ in both], np.mean([mean for _, mean in both])))
    return found


def scale_of(matches):
    """Scale and its sigma by a fit to the matches."""
    fit = fit_transform(
        np.stack([match.center for match in matches]),
        np.stack([match.displacement for match in matches]),
        np.stack([match.covariance for match in matches]),
        np.zeros((len(matches), 3, 0)),
        options=FitOptions(center_sigma_m=0.01),
    )
    return fit.similarity_numbers()[:2]


def test_boulders_that_spc_shortens_do_not_bias_the_scale(bodies):
    errors = []
    for matches, _ in bodies:
        assert all(match.usable for match in matches)
        scale, sigma = scale_of(matches)
        assert sigma < 6e-6
        assert abs(scale - SCALE) < 2 * sigma
        errors.append(scale - SCALE)
    assert abs(np.mean(errors)) < 5e-6


def test_the_mean_height_difference_is_biased_by_the_same_boulders(bodies):
    """What the robust match takes out: 2.5 cm of 245 m."""
    for _, mean in bodies:
        assert mean / RADIUS - (SCALE - 1.0) == pytest.approx(-1.1e-4, abs=1.5e-5)
