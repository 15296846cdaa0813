from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from fusion.registration.correlation import autocovariance, shift_variances
from fusion.registration.match import MatchOptions, Surface, match_surfaces
from fusion.registration.resolution import blur, estimate_blur, filled, plane_of
from spcola.maplet import MapletGrid

GRID = MapletGrid.facing([100.0, 40.0, 30.0], [1.0, 0.4, 0.3], 0.5, 49)


def terrain(seed, *, shift=(0.0, 0.0), smooth=2.0, relief=0.4):
    """Band-limited random surface (99 × 99), metres, moved by `shift` (x, y) cells exactly."""
    generator = np.random.default_rng(seed)
    spectrum = np.fft.fft2(generator.normal(size=(256, 256)))
    ky, kx = np.meshgrid(np.fft.fftfreq(256), np.fft.fftfreq(256), indexing="ij")
    spectrum *= np.exp(-2.0 * np.pi**2 * smooth**2 * (kx**2 + ky**2))
    spectrum *= np.exp(-2j * np.pi * (kx * shift[0] + ky * shift[1]))
    surface = np.fft.ifft2(spectrum).real
    return relief * surface[60:159, 60:159] / surface.std()


def matched(moving, fixed, **options):
    return match_surfaces("M", GRID, Surface(moving), Surface(fixed), **options)


def test_planted_displacement_is_recovered_without_noise():
    match = matched(terrain(1), terrain(1, shift=(1.3, -0.7)) + 0.25)
    assert match.usable
    # What is left is the error of the cubic spline that resamples.
    np.testing.assert_allclose(match.local, [0.65, -0.35, 0.25], atol=2e-3)
    np.testing.assert_allclose(GRID.axes @ match.displacement, match.local, atol=1e-12)
    assert match.correlation > 0.999


@pytest.mark.parametrize("correlated", [0.0, 2.0])
def test_pulls_are_of_unit_width_for_white_and_for_correlated_errors(correlated):
    pulls = []
    for seed in range(40):
        generator = np.random.default_rng(1000 + seed)
        noise = generator.normal(size=(99, 99))
        if correlated:
            noise = ndimage.gaussian_filter(noise, correlated, mode="wrap")
        noise *= 0.05 / noise.std()
        white = 0.02 * generator.normal(size=(99, 99))
        match = matched(terrain(seed) + white, terrain(seed, shift=(0.4, 0.3)) + noise + 0.1)
        pulls.append(
            (match.local - [0.2, 0.15, 0.1])
            / np.sqrt(np.diag(GRID.axes @ match.covariance @ GRID.axes.T))
        )
    width = np.sqrt(np.mean(np.square(pulls), axis=0))
    assert np.all((width > 0.75) & (width < 1.4)), width


def test_boulders_that_one_surface_lacks_do_not_pull():
    generator = np.random.default_rng(5)
    lidar, spc = terrain(3), terrain(3, shift=(0.5, 0.0))
    rows, columns = generator.integers(10, 90, size=(2, 15))
    for row, column in zip(rows, columns, strict=True):
        lidar[row - 2 : row + 3, column - 2 : column + 3] += 1.0
    match = matched(lidar, spc)
    np.testing.assert_allclose(match.local, [0.25, 0.0, 0.0], atol=0.02)


def test_gaps_do_not_matter_but_too_many_are_said():
    generator = np.random.default_rng(6)
    lidar, spc = terrain(4), terrain(4, shift=(0.0, 1.0))
    lidar[generator.random((99, 99)) < 0.02] = np.nan
    spc[:20, :30] = np.nan
    match = matched(lidar, spc)
    assert match.usable
    np.testing.assert_allclose(match.local, [0.0, 0.5, 0.0], atol=0.01)
    spc[:80] = np.nan
    refused = matched(lidar, spc)
    assert "of the grid is held by both" in refused.reason
    assert np.isnan(refused.displacement).all()


@pytest.mark.parametrize("surface", ["flat", "cylinder", "periodic"])
def test_terrain_that_cannot_hold_a_match_is_refused_or_uncertain(surface):
    generator = np.random.default_rng(7)
    y, x = np.mgrid[-49:50, -49:50].astype(float)
    base = {
        "flat": 0.0 * x,
        "cylinder": 0.3 * np.sin(x / 9.0) + 0.002 * x**2 / 10,
        "periodic": 0.3 * (np.sin(x) + np.sin(y)),
    }[surface]
    noisy = [base + 0.02 * generator.normal(size=x.shape) for _ in range(2)]
    match = matched(*noisy, options=MatchOptions(capture_m=4.0))
    if match.usable:
        sigma = np.sqrt(np.diag(GRID.axes @ match.covariance @ GRID.axes.T))
        assert sigma[1] > 20 * sigma[0]
    else:
        assert match.reason


def dark_part(seed):
    """SPC heights of which two fifths drift by half a metre without form, and their sigmas."""
    generator = np.random.default_rng(seed)
    spc, sigma = terrain(seed, shift=(0.4, 0.3)), np.full((99, 99), 0.05)
    spc += 0.05 * generator.normal(size=spc.shape)
    drift = ndimage.gaussian_filter(generator.normal(size=(99, 40)), 12.0)
    spc[:, :40] = ndimage.gaussian_filter(spc[:, :40], 8.0) + 0.3 + 0.3 * drift / drift.std()
    sigma[:, :40] = 0.5
    return spc, sigma


def test_ground_that_spc_hardly_knows_does_not_pull():
    errors = []
    for seed in range(6):
        spc, sigma = dark_part(seed)
        match = match_surfaces("M", GRID, Surface(terrain(seed)), Surface(spc, sigma))
        assert match.usable
        assert match.correlation > 0.9
        errors.append(match.local - [0.2, 0.15, 0.0])
        # All points alike: the dark ones pull by decimetres.
        plain = matched(terrain(seed), spc)
        assert not plain.usable or abs(plain.local[2]) > 3 * abs(match.local[2])
    # What is left of the dark ground's pull is a hundredth of its error of half a metre.
    assert np.max(np.abs(errors)) < 0.03
    assert np.sqrt(np.mean(np.square(errors))) < 0.01


@pytest.mark.parametrize("sigma", [np.nan, 0.0, 0.3])
def test_sigmas_that_are_alike_or_unknown_change_nothing(sigma):
    lidar, spc = terrain(3), terrain(3, shift=(0.5, 0.0))
    match = match_surfaces("M", GRID, Surface(lidar), Surface(spc, np.full((99, 99), sigma)))
    plain = matched(lidar, spc)
    np.testing.assert_allclose(match.local, plain.local, atol=1e-9)
    np.testing.assert_allclose(match.covariance, plain.covariance, rtol=1e-6)


def test_another_place_is_not_matched():
    match = matched(terrain(8), terrain(9))
    assert not match.usable


def test_shift_variance_equals_the_weighted_sum():
    generator = np.random.default_rng(10)
    moving, fixed = generator.normal(size=(2, 20, 20))
    known = generator.random((20, 20)) > 0.2
    weight = np.where(generator.random((20, 20)) > 0.2, generator.random((20, 20)), 0.0)
    variance = shift_variances(moving, known, fixed, weight, reach=2)
    for dy, dx in [(0, 0), (1, -2), (-2, 2)]:
        pairs = [
            (fixed[r, c] - moving[r - dy, c - dx], weight[r, c])
            for r in range(20)
            for c in range(20)
            if 0 <= r - dy < 20 and 0 <= c - dx < 20 and known[r - dy, c - dx]
        ]
        values, weights = np.array(pairs).T
        mean = np.average(values, weights=weights)
        expected = np.average((values - mean) ** 2, weights=weights)
        assert variance[dy + 2, dx + 2] == pytest.approx(expected, abs=1e-12)


def test_autocovariance_of_a_known_process():
    generator = np.random.default_rng(11)
    field = ndimage.uniform_filter(generator.normal(size=(400, 400)), 3, mode="wrap")
    field[generator.random(field.shape) < 0.1] = np.nan
    lags = autocovariance(field, 5)
    taper = 1 - np.abs(np.arange(-5, 6)) / 6
    expected = np.maximum(3 - np.abs(np.arange(-5, 6)), 0) / 9
    np.testing.assert_allclose(lags, np.outer(expected * taper, expected * taper), atol=2e-3)


def test_blur_leaves_planes_and_gaps_alone_and_is_found_again():
    y, x = np.mgrid[:99, :99].astype(float)
    plane = 3.0 + 0.2 * x - 0.1 * y
    plane[30:35, 40:50] = np.nan
    np.testing.assert_allclose(
        blur(plane, 2.0)[~np.isnan(plane)], plane[~np.isnan(plane)], atol=1e-9
    )
    assert np.isnan(blur(plane, 2.0)[32, 45])
    np.testing.assert_allclose(filled(plane), 3.0 + 0.2 * x - 0.1 * y, atol=1e-9)
    np.testing.assert_allclose(plane_of(plane), 3.0 + 0.2 * x - 0.1 * y, atol=1e-9)
    sharp = terrain(12, smooth=1.0)
    assert estimate_blur(sharp, blur(sharp, 1.5)) == pytest.approx(1.5, abs=0.05)
    assert estimate_blur(blur(sharp, 1.5), sharp) == pytest.approx(-1.5, abs=0.05)
    assert np.isnan(estimate_blur(np.full((99, 99), np.nan), sharp))


@pytest.mark.parametrize("relief", [0.03, 0.1, 0.3])
def test_noise_of_spc_does_not_make_the_lidar_the_softer_surface(relief):
    """Smoothing SPC would take its noise off and lessen the difference most, whatever its blur."""
    rng = np.random.default_rng(12)
    found = []
    for _ in range(6):
        ground = blur(rng.normal(size=(99, 99)), 1.5)
        ground *= relief / ground.std()
        noise = blur(rng.normal(size=(99, 99)), 2.0)
        spc = blur(ground, 1.0) + 0.1 / noise.std() * noise
        found.append(estimate_blur(ground + 0.01 * rng.normal(size=(99, 99)), spc))
    assert min(found) > 0.0
    assert np.median(found) == pytest.approx(1.0, abs=0.6 if relief < 0.05 else 0.35)
