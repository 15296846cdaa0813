from __future__ import annotations

import numpy as np
import pytest
from scipy.special import erf

from spcola.camera.stars import StarPositions, find_stars
from spcola.errors import InvalidValueError


def paint(spots, fluxes, width, noise, shape=(200, 220), seed=1):
    """An image with stars whose Gaussian is integrated over pixels."""
    image = 100.0 + noise * np.random.default_rng(seed).normal(size=shape)
    edges = [np.arange(side + 1) + 0.5 for side in shape]
    for (pixel, line), flux in zip(spots, fluxes, strict=True):
        down, along = (
            np.diff(0.5 * erf((edge - at) / (width * np.sqrt(2))))
            for edge, at in zip(edges, (line, pixel), strict=True)
        )
        image += flux * np.outer(down, along)
    return image


def stars(count, seed, shape=(200, 220)):
    random = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(np.arange(12, 208, 14), np.arange(12, 188, 14)), axis=-1).reshape(
        -1, 2
    )
    chosen = grid[random.permutation(len(grid))[:count]]
    return chosen + random.uniform(-0.5, 0.5, (count, 2)), random.uniform(300, 3000, count)


def nearest(found: StarPositions, spots):
    away = np.hypot(found.pixel - spots[:, :1], found.line - spots[:, 1:])
    return np.argmin(away, axis=1), np.min(away, axis=1)


@pytest.mark.parametrize("width", [0.5, 0.8, 1.3])
def test_places_are_unbiased_and_their_sigmas_right(width: float) -> None:
    pulls = []
    for seed in range(4):
        spots, flux = stars(120, seed)
        found = find_stars(paint(spots, flux, width, 5.0, seed=seed))
        where, away = nearest(found, spots)
        bright = (flux > 600) & (away < 1.0)
        assert np.all(away[flux > 600] < 1.0)
        miss = np.column_stack([found.pixel, found.line])[where[bright]] - spots[bright]
        pulls.append(miss / np.sqrt(np.diagonal(found.covariance[where[bright]], axis1=1, axis2=2)))
    both = np.concatenate(pulls)
    assert np.abs(np.mean(both)) < 0.1
    assert np.std(both) == pytest.approx(1.0, abs=0.1)


def test_exact_without_noise() -> None:
    spots, flux = stars(40, 3)
    found = find_stars(paint(spots, flux, 0.9, 1e-6))
    where, away = nearest(found, spots)
    assert len(found) == 40
    assert np.max(away) < 1e-6
    np.testing.assert_allclose(found.flux[where], flux, rtol=1e-5)


def test_particles_saturation_and_edges_are_left_out() -> None:
    spots, flux = stars(30, 5)
    image = paint(spots, flux, 0.9, 2.0)
    clean = len(find_stars(image))
    hits = image.copy()
    hits[5:195:20, 8] += 4000.0
    assert len(find_stars(hits)) == clean
    assert len(find_stars(image, saturation=400.0)) < clean
    image[100:, :] = np.nan
    assert np.all(find_stars(image).line < 98)


def test_an_empty_sky_has_few_stars() -> None:
    assert len(find_stars(paint([], [], 1.0, 3.0))) <= 1


@pytest.mark.parametrize("image", [np.zeros((5, 5)), np.zeros((50, 50)), np.zeros(9)])
def test_refuses(image) -> None:
    with pytest.raises(InvalidValueError):
        find_stars(image)
