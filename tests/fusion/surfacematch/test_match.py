from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from fusion.estimation.verdict import Cause
from fusion.surfacematch import MatchOptions, Surface, match_surfaces
from fusion.surfacematch.resolution import blur, estimate_blur, estimate_spectrum
from fusion.surfacematch.resolution.noise import supported
from spcola.grids import MapletGrid
from spcola.grids.correlation import autocovariance, shift_variances
from spcola.grids.gaps import bridged, filled, plane_of

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


def correlated_noise(generator, cells):
    """Noise of standard deviation 1 correlated over some cells."""
    noise = ndimage.gaussian_filter(generator.normal(size=(99, 99)), cells, mode="wrap")
    return noise / noise.std()


def errors_and_sigmas(seeds, spectrum):
    """Errors (S, 3) of matches under SPC's noise of 10 cm over five cells, and their sigmas."""
    rows = []
    for seed in seeds:
        generator = np.random.default_rng(2000 + seed)
        spc = blur(terrain(seed, shift=(0.4, 0.3), smooth=1.2, relief=0.3), 1.2)
        spc += 0.1 * correlated_noise(generator, 2.5) + 0.005 * generator.normal(size=spc.shape)
        lidar = terrain(seed, smooth=1.2, relief=0.3) + 0.01 * generator.normal(size=spc.shape)
        match = matched(lidar, spc, blur_cells=1.2, spectrum=spectrum)
        assert match.usable, match.reason
        spread = np.sqrt(np.diag(GRID.axes @ match.covariance @ GRID.axes.T))
        rows.append((match.local - [0.2, 0.15, 0.0], spread, match))
    return np.array([row[0] for row in rows]), np.array([row[1] for row in rows]), rows


def test_the_likelihood_of_correlated_errors_is_several_times_sharper_and_honest():
    plain, _, rows = errors_and_sigmas(range(30), None)
    spectrum = estimate_spectrum(row[2].residual for row in rows[:12])
    sharp, sigma, _ = errors_and_sigmas(range(30), spectrum)
    before, after = (np.sqrt(np.mean(np.square(errors[:, :2]))) for errors in (plain, sharp))
    assert after < 0.25 * before, (before, after)
    width = np.sqrt(np.mean(np.square(sharp / sigma), axis=0))
    assert np.all((width > 0.7) & (width < 1.35)), width


def test_spectrum_of_known_noise_and_its_filter():
    generator = np.random.default_rng(3)
    noise = [correlated_noise(generator, 2.0) for _ in range(20)]
    spectrum = estimate_spectrum(noise)
    known = np.exp(-4.0 * np.pi**2 * 2.0**2 * spectrum.wavenumber**2)
    strong = known > 0.05
    np.testing.assert_allclose(spectrum.power[strong], known[strong], atol=0.08)
    # Where the filter trusts the spectrum, what comes out is white.
    white = np.stack([spectrum.whitened(layer)[10:-10, 10:-10] for layer in noise])
    power = np.mean(np.abs(np.fft.rfft2(white)) ** 2, axis=0)
    k = np.hypot(np.fft.fftfreq(79)[:, None], np.fft.rfftfreq(79)[None, :])
    inside = (k > 0.02) & (k < 0.12)
    assert power[inside].std() / power[inside].mean() < 0.5
    # A constant is multiplied by the stated gain; noise of no variance gives no spectrum.
    np.testing.assert_allclose(spectrum.whitened(np.full((99, 99), 2.0)), 2.0 * spectrum.level)
    assert estimate_spectrum([np.full((99, 99), np.nan), np.zeros((99, 99))]) is None


def test_gaps_are_bridged_and_what_is_near_them_does_not_count():
    surface = terrain(4, smooth=3.0)
    holed = surface.copy()
    holed[50, 50] = np.nan
    assert bridged(holed)[50, 50] == pytest.approx(surface[50, 50], abs=0.04)
    known = np.isfinite(holed)
    assert supported(known)[50, 53]
    assert not supported(known)[50, 50]
    known[20:40, 20:40] = False
    assert not supported(known)[19, 30]
    assert supported(known)[15, 30]
    assert not bridged(np.full((5, 5), np.nan)).any()


def test_boulders_that_one_surface_lacks_do_not_pull():
    generator = np.random.default_rng(5)
    lidar, spc = terrain(3), terrain(3, shift=(0.5, 0.0))
    rows, columns = generator.integers(10, 90, size=(2, 15))
    for row, column in zip(rows, columns, strict=True):
        lidar[row - 2 : row + 3, column - 2 : column + 3] += 1.0
    match = matched(lidar, spc)
    np.testing.assert_allclose(match.local, [0.25, 0.0, 0.0], atol=0.02)


def test_gaps_do_not_matter_but_too_many_are_reported():
    generator = np.random.default_rng(6)
    lidar, spc = terrain(4), terrain(4, shift=(0.0, 1.0))
    lidar[generator.random((99, 99)) < 0.02] = np.nan
    spc[:20, :30] = np.nan
    match = matched(lidar, spc)
    assert match.usable
    np.testing.assert_allclose(match.local, [0.0, 0.5, 0.0], atol=0.01)
    spc[:80] = np.nan
    refused = matched(lidar, spc)
    assert "of the grid has both surfaces" in refused.reason
    assert refused.cause == "not-covered"
    assert np.isnan(refused.displacement).all()


def gappy(surface, share, seed):
    """A surface of which a share is known at random."""
    known = np.random.default_rng(9000 + seed).random(surface.shape) < share
    return np.where(known, surface, np.nan)


@pytest.mark.parametrize("share", [0.9, 0.71, 0.5])
def test_pulls_are_of_unit_width_however_many_points_are_missing(share):
    """As many points are compared as there are, and nearly as well as if none were missing."""
    pulls, whole, errors = [], [], []
    for seed in range(24):
        generator = np.random.default_rng(5000 + seed)
        spc = terrain(seed, shift=(0.4, 0.3), smooth=1.2, relief=0.3)
        spc = blur(spc, 1.2) + 0.02 * correlated_noise(generator, 2.0)
        lidar = terrain(seed, smooth=1.2, relief=0.3) + 0.01 * generator.normal(size=(99, 99))
        match = matched(gappy(lidar, share, seed), spc, blur_cells=1.2)
        assert match.usable, match.reason
        assert match.coverage == pytest.approx(share, abs=0.03)
        assert match.at_lidar
        spread = np.sqrt(np.diag(GRID.axes @ match.covariance @ GRID.axes.T))
        errors.append(match.local - [0.2, 0.15, 0.0])
        pulls.append(errors[-1] / spread)
        whole.append(matched(lidar, spc, blur_cells=1.2).local - [0.2, 0.15, 0.0])
    width = np.sqrt(np.mean(np.square(pulls), axis=0))
    assert np.all((width > 0.7) & (width < 1.4)), width
    better, found = (np.sqrt(np.mean(np.square(rows))) for rows in (whole, errors))
    assert found < 1.6 * better


@pytest.mark.parametrize("both", [False, True])
def test_either_surface_may_have_the_gaps(both):
    lidar, spc = terrain(8), terrain(8, shift=(0.4, -0.3)) + 0.25
    matches = [
        matched(gappy(lidar, 0.7, 1), gappy(spc, 0.95, 2) if both else spc),
        matched(gappy(lidar, 0.95, 1) if both else lidar, gappy(spc, 0.7, 2)),
    ]
    for match in matches:
        np.testing.assert_allclose(match.local, [0.2, -0.15, 0.25], atol=2e-3)
        assert match.coverage > (0.6 if both else 0.67)
        one, two = match.on_one_grid(lidar, spc)
        # Less their plane the surfaces are the same on that grid.
        left = two - one
        assert np.nanstd(left - plane_of(left)) < 0.01
    assert [match.at_lidar for match in matches] == [True, False]


@pytest.mark.parametrize("share", [1.0, 0.87, 0.71])
@pytest.mark.parametrize("cells", [0.0, 1.2, -1.2])
def test_a_surface_lies_on_itself(share, cells):
    """Displacement 0, converged, with a covariance, for any gaps and blur."""
    for seed in range(4):
        ground = terrain(seed, smooth=1.5)
        one = gappy(ground, share, seed) if cells >= 0 else blur(ground, 1.2)
        two = blur(ground, 1.2) if cells > 0 else gappy(ground, share, seed)
        match = matched(one, two, blur_cells=cells)
        assert match.usable, match.reason
        assert match.iterations < 10
        np.testing.assert_allclose(match.local, 0.0, atol=2e-3)
        assert np.all(np.linalg.eigvalsh(match.covariance) > 0.0)


@pytest.mark.parametrize("surface", ["flat", "ridged", "periodic"])
def test_what_terrain_does_not_determine_is_as_uncertain_as_the_capture_range(surface):
    """Along a ridge, or by whole periods, a surface slides over itself; up and down it does not."""
    y, x = np.mgrid[-49:50, -49:50].astype(float)
    base, determined = {
        "flat": (0.0 * x, [False, False]),
        "ridged": (0.3 * np.sin(x / 9.0) + 0.0002 * x**2, [True, False]),
        "periodic": (0.3 * (np.sin(x) + np.sin(y)), [False, False]),
    }[surface]
    pulls = []
    for seed in range(6):
        generator = np.random.default_rng(70 + seed)
        lidar, spc = (base + 0.02 * generator.normal(size=x.shape) for _ in range(2))
        sigma = np.full(x.shape, 0.02)
        match = match_surfaces(
            "M", GRID, Surface(lidar, sigma), Surface(spc + 0.4, sigma),
            options=MatchOptions(capture_m=4.0),
        )  # fmt: skip
        assert match.usable, match.reason
        spread = np.sqrt(np.diag(GRID.axes @ match.covariance @ GRID.axes.T))
        for axis in range(2):
            assert spread[axis] < 0.05 if determined[axis] else spread[axis] > 3.0
            assert abs(match.local[axis]) < 3 * spread[axis]
        pulls.append((match.local[2] - 0.4) / spread[2])
        assert spread[2] < 0.005
    assert np.sqrt(np.mean(np.square(pulls))) < 1.6


def dark_part(seed):
    """SPC heights of which two fifths drift by half a metre without form, and their sigmas."""
    generator = np.random.default_rng(seed)
    spc, sigma = terrain(seed, shift=(0.4, 0.3)), np.full((99, 99), 0.05)
    spc += 0.05 * generator.normal(size=spc.shape)
    drift = ndimage.gaussian_filter(generator.normal(size=(99, 40)), 12.0)
    spc[:, :40] = ndimage.gaussian_filter(spc[:, :40], 8.0) + 0.3 + 0.3 * drift / drift.std()
    sigma[:, :40] = 0.5
    return spc, sigma


def test_ground_with_large_spc_sigmas_has_little_weight():
    errors = []
    for seed in range(6):
        spc, sigma = dark_part(seed)
        match = match_surfaces("M", GRID, Surface(terrain(seed)), Surface(spc, sigma))
        assert match.usable
        assert match.correlation > 0.9
        errors.append(match.local - [0.2, 0.15, 0.0])
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
    taper = 0.5 + 0.5 * np.cos(np.pi * np.arange(-5, 6) / 6)
    expected = np.maximum(3 - np.abs(np.arange(-5, 6)), 0) / 9
    np.testing.assert_allclose(lags, np.outer(expected * taper, expected * taper), atol=2e-3)


def test_blur_leaves_the_roundness_of_the_body_alone():
    y, x = np.mgrid[-49:50, -49:50].astype(float)
    round_ground = -(x**2 + 0.7 * y**2 - 0.3 * x * y) / 300.0
    np.testing.assert_allclose(blur(round_ground, 2.0), round_ground, atol=1e-9)


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


@pytest.mark.parametrize("half_size", [1, 2])
def test_a_grid_of_a_few_points_is_refused_with_a_reason(half_size):
    grid = MapletGrid.facing([250.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.5, half_size)
    surface = Surface(np.random.default_rng(1).normal(size=grid.shape), np.full(grid.shape, 0.05))
    match = match_surfaces("AA0001", grid, surface, surface)
    assert match.cause == Cause.NOT_COVERED
    assert np.isnan(match.displacement).all()
