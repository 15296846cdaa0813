"""The albedo of known ground, from photographs that are made without the code under test."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from spcola.errors import InvalidValueError, SettingsError
from spcola.grids import Maplet, MapletGrid
from spcola.heights.slopes import slopes_of
from spcola.photometry.albedo import AlbedoOptions, AlbedoOutcome, solve_albedo, windows
from spcola.photometry.functions import lambert
from spcola.photometry.photoclinometry import AlbedoConvention, Fit, PhotoclinometryOptions

# Directions to camera and Sun.
SIGHTS = [
    ([0.3, 0.0, 1.0], [0.7, 0.1, 0.8]),
    ([-0.4, 0.2, 1.0], [-0.5, 0.4, 0.8]),
    ([0.1, -0.4, 1.0], [0.2, -0.6, 0.8]),
    ([0.0, 0.0, 1.0], [-0.6, -0.3, 0.8]),
]
SOLVER = PhotoclinometryOptions(function=lambert, least_error=1e-3, albedo_sigma=0.2, rounds=12)
OPTIONS = AlbedoOptions(SOLVER, slope_error=0.0)


def having(**given):
    return AlbedoOptions(replace(SOLVER, **given), slope_error=0.0)


def photographed(ground, sights=SIGHTS, **options):
    options = {"pixel": 0.5, "size": 90, **options}
    return [
        ground.photograph(f"I{k}", toward, sun, **options) for k, (toward, sun) in enumerate(sights)
    ]


def solved(ground, images, options=OPTIONS, height=None, **given):
    maplet = Maplet("KNOWN", ground.grid, ground.heights() if height is None else height)
    states = {image.name: 1e-14 * np.eye(6) for image in images}
    return solve_albedo(maplet, images, states, options=options, **given)


def painted_points(ground):
    """The albedo at the points of a grid; its mean over the cells is 1."""
    steps = ground.grid.offsets * ground.grid.gsd
    middle = steps[1:] - 0.5 * ground.grid.gsd
    scale = ground.albedo(*np.meshgrid(middle, middle)).mean()
    return ground.albedo(*np.meshgrid(steps, steps)) / scale


def inner(layer, edge=4):
    return layer[..., edge:-edge, edge:-edge]


def correlation(one, other):
    known = np.isfinite(one + other)
    return float(np.corrcoef(one[known], other[known])[0, 1])


@pytest.fixture(scope="module")
def photographs(painted):
    return photographed(painted)


@pytest.fixture(scope="module")
def found(painted, photographs):
    return solved(painted, photographs)


def test_noiseless_images_return_the_painted_albedo(painted, found):
    error = inner(found.albedo / painted_points(painted)) - 1.0
    assert np.isfinite(error).all()
    assert np.sqrt(np.mean(error**2)) < 0.003
    assert np.abs(error).max() < 0.01
    assert found.outcome is AlbedoOutcome.CONVERGED
    assert found.residual < 0.1 * found.residual_start


def test_one_image_is_enough(painted, photographs):
    alone = solved(painted, photographs[:1])
    error = inner(alone.albedo / painted_points(painted)) - 1.0
    assert np.nanmax(np.abs(error)) < 0.01
    assert np.isfinite(error).mean() > 0.99


def test_topography_does_not_enter_the_albedo(painted, found, waves):
    along = inner(np.array(slopes_of(painted.heights(), painted.grid.gsd)))
    planted = inner(painted_points(painted))
    for slope in along:
        assert abs(correlation(inner(found.albedo), slope) - correlation(planted, slope)) < 0.01
    # Ground of even albedo, heights with an error of 2 cm: slopes are wrong by 0.04.
    rng = np.random.default_rng(3)
    rough = waves.heights() + rng.normal(0.0, 0.02, waves.grid.shape)
    options = AlbedoOptions(SOLVER, slope_error=0.04)
    even = solved(waves, photographed(waves), options, rough)
    for slope in inner(np.array(slopes_of(waves.heights(), waves.grid.gsd))):
        assert abs(correlation(inner(even.albedo), slope)) < 0.1
    assert np.std(inner(even.albedo)) < 0.05


def test_a_trend_of_the_albedo_is_no_change_of_the_images_scales(painted):
    class Sloping(type(painted)):
        def albedo(self, x, y):
            return 1.0 + 0.01 * x - 0.005 * y

    sloping = Sloping(painted.grid)
    found = solved(sloping, photographed(sloping, SIGHTS[:2]))
    error = inner(found.albedo / painted_points(sloping)) - 1.0
    assert np.abs(error).max() < 0.01


def test_sigmas_are_the_errors_that_noise_and_slopes_make(painted, photographs):
    rng = np.random.default_rng(5)
    noisy = [
        replace(
            image, pixels=(image.pixels * rng.normal(1.0, 0.05, image.pixels.shape)).astype("u2")
        )
        for image in photographs
    ]
    rough = painted.heights() + rng.normal(0.0, 0.02, painted.grid.shape)
    by_slopes = solved(painted, photographs[:1], AlbedoOptions(SOLVER, slope_error=0.04), rough)
    # Sigmas are those of a cell, and points have the mean of four.
    for one, least in ((solved(painted, noisy), 0.5), (by_slopes, 0.35)):
        pull = inner((one.albedo - painted_points(painted)) / one.sigma)
        assert least < np.nanstd(pull) < 1.0
        assert np.nanmean(np.abs(pull) < 2.0) > 0.95


def test_shadow_in_all_images_leaves_the_albedo_unknown(ridge):
    low = [([0.2, 0.1, 1.0], [0.9, 0.0, 0.35]), ([0.0, -0.3, 1.0], [0.9, 0.2, 0.3])]
    steps = ridge.grid.offsets * ridge.grid.gsd
    where = np.meshgrid(steps, steps)
    suns = [np.array(sun) / np.linalg.norm(sun) for _, sun in low]
    dark = np.logical_and(*(ridge.shaded(*where, sun) for sun in suns))
    assert inner(dark).mean() > 0.04
    one_side = solved(ridge, photographed(ridge, low))
    # Half-lit cells at the edge of the shadow are left aside.
    core = dark & np.roll(dark, 1, axis=1) & np.roll(dark, -1, axis=1)
    core[:4], core[-4:] = False, False
    assert np.isnan(one_side.albedo[core]).mean() > 0.95
    np.testing.assert_array_equal(np.isnan(one_side.albedo), np.isnan(one_side.sigma))
    lit = ~(dark | np.roll(dark, 2, axis=1) | np.roll(dark, -2, axis=1))
    error = one_side.albedo / painted_points(ridge) - 1.0
    level = np.nanmedian(error)
    assert np.nanmedian(np.abs(inner(np.where(lit, error - level, np.nan)))) < 0.01
    both_sides = solved(ridge, photographed(ridge, [*low, ([-0.2, 0.0, 1.0], [-0.6, 0.1, 0.7])]))
    assert np.isfinite(both_sides.albedo[core]).all()
    error = (both_sides.albedo / painted_points(ridge) - 1.0)[core]
    assert np.median(np.abs(error)) < 0.03


def test_a_grid_in_windows_has_the_albedo_of_the_whole_without_steps(painted, monkeypatch):
    grid = MapletGrid(painted.grid.center, painted.grid.axes, 0.5, 60)
    large = type(painted)(grid)
    images = photographed(large, SIGHTS[:3], pixel=1.0, size=96)
    assert len(windows.windows_of(grid)) == 4
    parts = solved(large, images)
    error = inner(parts.albedo / painted_points(large)) - 1.0
    assert np.sqrt(np.mean(error**2)) < 0.003
    step = np.diff(error, axis=1)
    seam = 60 - 4
    assert abs(np.mean(step[:, seam - 1])) < 3e-4
    monkeypatch.setattr(windows, "_INNER", 200)
    assert len(windows.windows_of(grid)) == 1
    whole = solved(large, images)
    assert np.nanstd(inner(parts.albedo - whole.albedo)) < 1e-3
    assert np.nanmedian(parts.sigma / whole.sigma) == pytest.approx(1.0, abs=0.3)


@pytest.mark.parametrize("half", [1, 56, 57, 60, 100, 151])
def test_windows_determine_each_cell_once(half):
    grid = MapletGrid.facing([1e3, 0, 0], [1, 0, 0], 1.0, half)
    count, plane = np.zeros((2 * half, 2 * half), dtype=int), grid.points(np.zeros(grid.shape))
    for window in windows.windows_of(grid):
        count[window.inner] += 1
        rows, columns = window.cells
        part = plane[rows.start : rows.stop + 1, columns.start : columns.stop + 1]
        np.testing.assert_allclose(window.grid.points(np.zeros(window.grid.shape)), part)
        np.testing.assert_array_equal(np.argwhere(window.inside)[0], [r.start for r in window.own])
    assert (count == 1).all()


def test_a_plane_of_the_scale_is_the_same_in_a_window(painted):
    grid = MapletGrid.facing([1e3, 0, 0], [1, 0, 0], 1.0, 100)
    window = windows.windows_of(grid)[1]
    whole = replace(windows.ImageState.unknown(), scale=3.0, gradient=np.array([0.2, -0.1]))
    part = window.state(whole)

    def plane(state, cells):
        y, x = ((2.0 * np.arange(cells) + 1.0) / cells - 1.0 for _ in range(2))
        gain = 1.0 + state.gradient[0] * x + state.gradient[1] * y[:, None]
        return state.scale * gain

    np.testing.assert_allclose(plane(part, 112), plane(whole, 200)[window.cells])


def test_gaps_of_single_points_are_bridged_and_wide_ones_stay_unknown(painted, photographs):
    height = painted.heights()
    rng = np.random.default_rng(2)
    height[rng.random(height.shape) < 0.1] = np.nan
    height[5:20, 40:55] = np.nan
    gappy = solved(painted, photographs, height=height)
    assert np.isnan(gappy.albedo[np.isnan(height)]).all()
    error = inner(gappy.albedo / painted_points(painted)) - 1.0
    assert np.nanmedian(np.abs(error - np.nanmedian(error))) < 0.01
    assert np.isfinite(gappy.albedo[np.isfinite(height)]).mean() > 0.95
    maplet = gappy.on(Maplet("GAPPY", painted.grid, height))
    assert (maplet.albedo[np.isnan(height)] == 1.0).all()


def test_both_published_conventions(painted, photographs, found):
    half = solved(painted, photographs, having(convention=AlbedoConvention.published(0.5)))
    np.testing.assert_allclose(half.albedo, 0.5 * found.albedo, atol=1e-6)
    np.testing.assert_allclose(half.sigma, 0.5 * found.sigma, atol=1e-6)
    capped = solved(painted, photographs, having(convention=AlbedoConvention(1.0, 1.05)))
    assert np.nanmax(capped.albedo) <= 1.05
    narrow = AlbedoConvention(range_sigmas=0.5)
    assert np.nanstd(
        solved(painted, photographs, having(convention=narrow)).albedo
    ) < 0.7 * np.nanstd(found.albedo)


def test_an_image_of_nothing_is_named(painted, photographs):
    black = replace(photographs[0], pixels=np.zeros_like(photographs[0].pixels))
    none = solved(painted, [black])
    assert none.outcome is AlbedoOutcome.NO_IMAGE
    assert none.images[0].fit is Fit.NOT_SEEN
    assert np.isnan(none.albedo).all()
    assert none.share == 0.0


@pytest.mark.parametrize("lines", [1, -1], ids=["mirrored", "upside down"])
def test_an_image_of_other_ground_is_named(painted, photographs, lines):
    other = replace(photographs[1], pixels=photographs[1].pixels[::lines, ::-1].copy())
    found = solved(painted, [photographs[0], other, *photographs[2:]])
    assert [fit.name for fit in found.images if fit.fit is not Fit.USED] == ["I1"]


def test_displaced_images_are_moved_back(painted, photographs):
    camera = photographs[0].camera
    center = camera.center + np.array([0.4, -0.3])
    moved = replace(photographs[0], camera=replace(camera, center=center))
    ground = Maplet("KNOWN", painted.grid, painted.heights())
    loose = {image.name: np.diag([2e-4] * 2 + [1e-9] * 4) ** 2 for image in photographs}
    found = solve_albedo(ground, [moved, *photographs[1:]], loose, options=OPTIONS)
    np.testing.assert_allclose(found.images[0].shift_px, [-0.4, 0.3], atol=0.03)
    error = inner(found.albedo / painted_points(painted)) - 1.0
    assert np.sqrt(np.mean(error**2)) < 0.005


def test_what_cannot_be_solved_is_refused(painted, photographs):
    with pytest.raises(InvalidValueError, match="has no height"):
        solved(painted, photographs, height=np.full(painted.grid.shape, np.nan))
    with pytest.raises(InvalidValueError, match="has no pixels"):
        solved(painted, [replace(photographs[0], pixels=None)])
    with pytest.raises(SettingsError):
        AlbedoOptions(slope_error=-1.0)


@pytest.mark.parametrize("given", [(1.0, 1.0), (0.0, 2.0), (1.0, 2.0, 0.0), (0.5, float("nan"))])
def test_conventions_out_of_range_are_refused(given):
    with pytest.raises(SettingsError):
        AlbedoConvention(*given)
    with pytest.raises(SettingsError):
        AlbedoConvention.published(0.7)
