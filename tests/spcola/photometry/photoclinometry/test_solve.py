"""Photoclinometry of photographs of waves, made without the code under test."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from photographs import Painted
from scipy import ndimage
from solved_photographs import SIGHTS, slope_error, solved_flat

from spcola.camera import project_image
from spcola.control.estimation import shift_covariance
from spcola.errors import InvalidValueError, SettingsError
from spcola.grids import Maplet
from spcola.grids.bending import bending_around
from spcola.heights.slopes import slopes_of
from spcola.photometry.functions import lambert
from spcola.photometry.ground import at_cells
from spcola.photometry.photoclinometry import (
    AlbedoConvention,
    Comparison,
    Fit,
    HeightConstraint,
    Outcome,
    PhotoclinometryOptions,
    solve_photoclinometry,
)
from spcola.photometry.photoclinometry.surface import cell_slopes

KNOWN = 1e-14 * np.eye(6)
FEW_ROUNDS = PhotoclinometryOptions(function=lambert, least_error=1e-3, settled_gsd=5e-3)
# The function is right: brightness changes over the grid only as it states.
NOISELESS = PhotoclinometryOptions(
    function=lambert, least_error=1e-3, rounds=20, settled_gsd=5e-4, gradient_sigma=1e-4,
    shift_sigma_px=1e-3, slope_sigma=1.0, albedo_sigma=0.2,
)  # fmt: skip


def flat(grid):
    return Maplet("FLAT", grid, np.zeros(grid.shape))


def known_states(images):
    return {image.name: KNOWN for image in images}


def one_height(painted):
    """The height of one point."""
    height = np.full(painted.grid.shape, np.nan)
    height[30, 30] = painted.heights()[30, 30]
    return HeightConstraint.of_sigma("one", height, 1e-3)


def inner(layer, edge=4):
    return layer[..., edge:-edge, edge:-edge]


def solved(painted, images, options=NOISELESS, **given):
    given = {"constraints": [one_height(painted)], **given}
    return solve_photoclinometry(
        flat(painted.grid), images, known_states(images), options=options, **given
    )


@pytest.fixture(scope="module")
def noiseless(painted, photographs):
    return solved(painted, photographs)


def test_noiseless_images_of_a_smooth_surface_return_slopes_albedo_and_heights(painted, noiseless):
    truth = painted.heights()
    error = inner(noiseless.maplet.height - truth)
    assert np.sqrt(np.mean(error**2)) < 0.01 * np.std(truth)
    slopes = np.array(slopes_of(noiseless.maplet.height, painted.grid.gsd))
    wrong = inner(slopes - np.array(slopes_of(truth, painted.grid.gsd)))
    assert np.sqrt(np.mean(wrong**2)) < 1e-3
    albedo = inner(at_cells(noiseless.maplet.albedo) / painted.cell_albedo())
    assert np.std(albedo) < 0.005
    assert (noiseless.directions == 2).mean() > 0.9


def test_images_are_found_where_they_are(noiseless):
    for fit in noiseless.images:
        assert fit.fit is Fit.USED
        assert np.hypot(*fit.shift_px) < 0.01
        assert fit.scale == pytest.approx(20000.0, rel=0.02)
        assert fit.correlation > 0.99


def test_the_order_of_the_images_does_not_matter(painted, photographs):
    once = solved(painted, photographs, FEW_ROUNDS)
    again = solved(painted, photographs[::-1], FEW_ROUNDS)
    # Each round's heights are solved to 1e-3, so that rounding changes weakly determined edges.
    np.testing.assert_allclose(once.maplet.height, again.maplet.height, atol=1e-4)
    assert np.std(once.maplet.height - again.maplet.height) < 1e-6
    assert [fit.name for fit in once.images] == [fit.name for fit in again.images][::-1]


@pytest.mark.parametrize("unit", [1e-18, 1e18])
def test_the_unit_of_brightness_does_not_matter(painted, photographs, unit):
    once = solved(painted, photographs, FEW_ROUNDS)
    other = [
        replace(
            image,
            pixels=unit * np.asarray(image.pixels, dtype=np.float64),
            thresholds=tuple(unit * limit for limit in image.thresholds),
        )
        for image in photographs
    ]
    again = solved(painted, other, FEW_ROUNDS)
    # Each round's heights are solved to 1e-3, so that rounding changes weakly determined edges.
    np.testing.assert_allclose(again.maplet.height, once.maplet.height, atol=1e-4)
    np.testing.assert_allclose(again.maplet.sigma, once.maplet.sigma, rtol=1e-3)
    assert again.images[0].scale == pytest.approx(unit * once.images[0].scale, rel=1e-6)


def test_displaced_images_are_moved_back(painted, photographs):
    shift = np.array([[0.8, -0.5], [-0.6, 0.4], [0.3, 0.7], [-0.7, -0.6], [0.5, 0.4], [-0.3, -0.4]])
    moved = [
        replace(image, camera=replace(image.camera, center=image.camera.center + off))
        for image, off in zip(photographs, shift, strict=True)
    ]
    loose = {image.name: np.diag([2e-4] * 2 + [1e-9] * 4) ** 2 for image in moved}
    found = solve_photoclinometry(
        flat(painted.grid), moved, loose, constraints=[one_height(painted)], options=FEW_ROUNDS
    )
    left = np.array([fit.shift_px for fit in found.images]) + shift
    # A shift that all images share displaces the surface, and no image shows that.
    assert np.abs(left - left.mean(axis=0)).max() < 0.1
    fitted = np.array([fit.shift_px for fit in found.images])
    sigma = [np.sqrt(np.trace(shift_covariance(one, loose[one.name], painted.grid.center)) / 2)
             for one in moved]  # fmt: skip
    expected = np.median(np.sqrt(np.mean(fitted**2, axis=1)) / sigma)
    assert found.shift_ratio == pytest.approx(expected, rel=0.1)
    exact = solved(painted, moved, FEW_ROUNDS)
    assert exact.shift_ratio > 3.0 > found.shift_ratio


def test_ground_that_one_image_shows_does_not_determine_its_shift(painted, photographs):
    """Its heights follow the image wherever that is: they are no ground to compare it with."""
    first, second = photographs[0], photographs[3]

    def without_hole(image):
        line, pixel = np.indices(image.pixels.shape)
        hidden = project_hole(image, painted.grid, line, pixel)
        return replace(image, pixels=np.where(hidden, 0, image.pixels).astype(np.uint16))

    loose = np.diag([2e-4] * 2 + [1e-9] * 4) ** 2
    sigmas = []
    for images in ([first, without_hole(second)], [without_hole(first), without_hole(second)]):
        states = {image.name: loose for image in images}
        found = solve_photoclinometry(flat(painted.grid), images, states, options=FEW_ROUNDS)
        sigmas.append(np.median(found.maplet.sigma[30:-4, 30:-4]))
    assert sigmas[0] == pytest.approx(sigmas[1], rel=0.2), sigmas


def test_flat_ground_without_any_constraint_does_not_leave_in_one_round(painted, photographs):
    """No gradient of brightness determines its mean height yet."""
    once = replace(FEW_ROUNDS, levels=(4, 1), rounds=1)
    start = flat(painted.grid)
    found = solve_photoclinometry(start, photographs, known_states(photographs), options=once)
    assert found.outcome is not Outcome.DIVERGED
    assert abs(np.mean(found.maplet.height)) < 30.0 * painted.grid.gsd


def test_stereo_gives_the_height_without_any_constraint(painted, photographs):
    found = solve_photoclinometry(
        flat(painted.grid), photographs, known_states(photographs), options=FEW_ROUNDS
    )
    # A height of 0.1 m displaces the ground by a tenth of a pixel in the most oblique images.
    assert abs(np.mean(inner(found.maplet.height - painted.heights()))) < 0.1


def test_a_mean_height_that_nothing_determines_has_a_sigma_beyond_all_relief(painted):
    """In one light no cell has both directions of its slope, and its stereo is not used."""
    light = [0.7, 0.0, 0.7]
    images = [
        painted.photograph(f"S{k}", toward, light, size=90)
        for k, toward in enumerate([[0.3, 0.2, 1.0], [-0.2, 0.3, 1.0], [0.1, -0.3, 1.0]])
    ]
    found = solved(painted, images, FEW_ROUNDS, constraints=[])
    assert not (found.directions == 2).any()
    known = np.isfinite(found.maplet.height)
    assert known.any()
    assert np.all(found.maplet.sigma[known] > 100.0 * painted.grid.gsd)


def test_sigmas_contain_errors_of_contrast(painted, photographs):
    """Brightness is added to each image: relief looks lower, and the surface is tilted and bent."""
    sigma = 0.03
    options = replace(FEW_ROUNDS, contrast_sigma=sigma)
    right = solved(painted, photographs, options)
    pulls, tilts = [], []
    for seed in range(3):
        added = sigma * np.random.default_rng(seed).normal(size=len(photographs))
        wrong = [
            replace(one, pixels=one.pixels + share * np.mean(one.pixels[one.pixels > 0]))
            for one, share in zip(photographs, added, strict=True)
        ]
        found = solved(painted, wrong, options)
        wrong_by = found.maplet.height - right.maplet.height
        pulls.append(inner(wrong_by / right.maplet.sigma))
        tilts.append(cell_slopes(wrong_by, painted.grid.gsd) / right.slope_sigma)
    for spread in (np.sqrt(np.mean(np.square(one))) for one in (pulls, tilts)):
        assert 0.5 < spread < 1.5, spread
    without = solved(painted, photographs, replace(options, contrast_sigma=1e-6))
    assert np.median(right.maplet.sigma) > 2.0 * np.median(without.maplet.sigma)
    assert np.median(right.slope_sigma) > np.median(without.slope_sigma)


def test_areas_of_another_albedo_are_no_relief_and_noise_is_no_albedo(painted):
    """Independent cells take areas for relief, and noise for albedo, whatever their sigma."""
    rng = np.random.default_rng(11)
    images = [painted.photograph(f"N{k}", *SIGHTS[k], size=90) for k in (0, 1, 3, 5)]
    noisy = [
        replace(one, pixels=one.pixels * rng.normal(1.0, 0.08, one.pixels.shape)) for one in images
    ]
    slopes, albedos = [], []
    field = PhotoclinometryOptions(function=lambert)
    free = replace(field, albedo_step_sigma=1e3)
    for options in (field, free, *(replace(free, albedo_sigma=sigma) for sigma in (0.05, 0.08))):
        found = solved(painted, noisy, options)
        wrong = found.maplet.height - painted.heights()
        slopes.append(np.std(inner(cell_slopes(wrong, painted.grid.gsd))))
        albedos.append(np.std(inner(at_cells(found.maplet.albedo) / painted.cell_albedo())))
    assert slopes[0] < min(slopes[1:])
    assert albedos[0] < 0.8 * min(albedos[1:])


def test_images_in_one_light_determine_one_direction_of_the_slope(painted, photographs):
    light = [0.7, 0.0, 0.7]
    images = [
        painted.photograph(f"S{k}", toward, light, size=90)
        for k, (toward, _) in enumerate(SIGHTS[:3])
    ]
    right = replace(FEW_ROUNDS, albedo_sigma=0.02, contrast_sigma=1e-6)
    found = solved(painted, images, right)
    assert np.median(inner(found.directions)) == 1
    assert found.outcome is Outcome.UNDETERMINED
    assert "both directions of the slope" in found.reason
    # One slope is free, so that heights are hardly better known than without any image.
    several = solved(painted, photographs, right)
    assert np.median(found.maplet.sigma) > 5.0 * np.median(several.maplet.sigma)
    assert np.median(found.slope_sigma) > 20.0 * np.median(several.slope_sigma)
    # The prior of slopes is all that is known along the other direction, and nothing otherwise.
    independent = replace(right, slope_error_factor=1.0)
    for images_of, wider in ((images, 1.65), (photographs, 1.0)):
        sigmas = [
            np.median(solved(painted, images_of, options).maplet.sigma)
            for options in (right, independent)
        ]
        assert sigmas[0] / sigmas[1] == pytest.approx(wider, rel=0.1)
    heights = HeightConstraint.of_sigma("all", painted.heights(), 0.1)
    constrained = solved(painted, images, FEW_ROUNDS, constraints=[heights])
    assert constrained.outcome is not Outcome.UNDETERMINED
    many = solved(
        painted,
        [*images, *(painted.photograph(f"T{k}", t, s) for k, (t, s) in enumerate(SIGHTS[1:4]))],
        FEW_ROUNDS,
    )
    assert np.median(inner(many.directions)) == 2


def test_the_departure_from_an_independent_start_shows_how_wrong_its_slopes_are(painted):
    light = [0.7, 0.0, 0.7]
    images = [
        painted.photograph(f"S{k}", toward, light, size=90)
        for k, (toward, _) in enumerate(SIGHTS[:3])
    ]
    truth, options = painted.heights(), replace(FEW_ROUNDS, contrast_sigma=1e-6)
    independent = replace(options, independent_start=True)

    def sigma_of(share, given):
        start = Maplet("START", painted.grid, truth * share)
        found = solve_photoclinometry(
            start, images, known_states(images), constraints=[one_height(painted)], options=given
        )
        return np.median(found.maplet.sigma)

    # Across the light nothing else is known: a start half as wrong leaves sigmas half as large.
    assert sigma_of(0.5, independent) / sigma_of(0.0, independent) == pytest.approx(0.5, abs=0.1)
    # A surface that was solved from the same images agrees with them, and proves nothing.
    assert sigma_of(0.999, options) == pytest.approx(sigma_of(0.9, options), rel=0.01)


def test_near_heights_single_slopes_of_the_start_err_and_elsewhere_all_of_them_together(painted):
    """Errors of slopes that are alike in neighbouring cells add up where nothing measures."""
    grid = painted.grid
    images = [
        painted.photograph(f"S{k}", toward, [0.7, 0.0, 0.7], size=90)
        for k, (toward, _) in enumerate(SIGHTS[:3])
    ]
    upper = np.indices(grid.shape)[0] > grid.half_size
    inside = at_cells(upper.astype(np.float64)) == 1.0
    tiny = dict.fromkeys(("contrast_sigma", "bend_sigma", "top_sigma", "measured_bend_sigma"), 1e-6)
    options = replace(FEW_ROUNDS, independent_start=True, **tiny)

    def slopes_across(share, sigma, options=options):
        """Sigmas of slopes across the light, near heights and elsewhere; departures near them."""
        start = Maplet("START", grid, share * painted.heights())
        heights = np.where(upper, painted.heights(), np.nan)
        # So weak that slopes across the light are those of the start.
        weak = HeightConstraint.of_sigma("upper", heights, sigma * grid.gsd)
        found = solve_photoclinometry(
            start, images, known_states(images), constraints=[weak, one_height(painted)],
            options=options,
        )  # fmt: skip
        away = cell_slopes((found.maplet.height - start.height), grid.gsd)[:, inside]
        across = found.slope_sigma[1]
        return np.median(across[inside]), np.median(across[~inside]), np.sqrt(np.mean(away**2))

    near, far, single = slopes_across(0.5, 0.9)
    other_near, _, other_single = slopes_across(0.8, 0.9)
    assert far > 5.0 * near
    assert single > 2.0 * other_single
    assert near / single == pytest.approx(other_near / other_single, rel=0.05)
    # Heights that are known to less than a GSD measure nothing.
    unmeasured, far, _ = slopes_across(0.5, 1.1)
    assert unmeasured > 0.5 * far
    # A start of the same heights agrees with them, and proves nothing.
    dependent = replace(options, independent_start=False)
    one, far, _ = slopes_across(0.5, 0.9, dependent)
    other, _, _ = slopes_across(0.999, 0.9, dependent)
    assert other == pytest.approx(one, rel=0.05)
    assert far > 1.2 * one


def test_slopes_that_no_image_shows_depart_twice_as_much_as_others(painted, photographs):
    """Shadows fall where the ground is steep."""
    grid = painted.grid
    hidden = [replace(one, pixels=one.pixels.copy()) for one in photographs]
    for image in hidden:
        x = project_image(image, grid.points(painted.heights()))[0]
        image.pixels[:, int(np.median(x)) :] = 0.0
    # Slopes alone, and no twist of cells, hold heights of ground in the dark.
    options = replace(FEW_ROUNDS, independent_start=True, twist_sigma=100.0)

    def dark(share):
        """Sigma of slopes in the dark, and the departure of the heights that images show."""
        start = Maplet("START", grid, share * painted.heights())
        found = solve_photoclinometry(
            start, hidden, known_states(hidden), constraints=[one_height(painted)], options=options
        )
        unseen, seen = found.directions == 0, found.directions == 2
        assert np.mean(unseen) > 0.2
        assert np.mean(seen) > 0.2
        around = at_cells(np.pad(seen.astype(np.float64), 1)) == 1.0
        departure = np.std((found.maplet.height - start.height)[around]) / grid.gsd
        return np.median(found.slope_sigma[:, unseen]), departure

    sigma, departure = dark(0.8)
    # Two slopes of a cell measure each difference of heights: its sigma is that of a slope over √2.
    assert sigma == pytest.approx(2.0 * departure / np.sqrt(2.0), rel=0.1)


@pytest.mark.parametrize("error", [0.05, 0.3, 5.0])
def test_images_show_the_sigma_of_heights_of_unknown_sigma(painted, photographs, error):
    grid, largest, least = painted.grid, 1.0, 0.2
    errors = ndimage.gaussian_filter(np.random.default_rng(5).normal(size=grid.shape), 3.0)
    heights = painted.heights() + error * errors / np.std(errors)
    assumed = HeightConstraint.of_sigma("shape", heights, largest, common=100.0)
    unknown = replace(assumed, least_sigma=least)
    at_first, seen = (
        solved(painted, photographs, FEW_ROUNDS, constraints=[one]).constraints[0]
        for one in (assumed, unknown)
    )
    # The residual over its sigma is that of the largest sigma, times how much it was lowered.
    lowered = largest / np.clip(error, least, largest)
    assert seen.ratio / at_first.ratio == pytest.approx(lowered, rel=0.1)
    assert seen.residual_m == pytest.approx(at_first.residual_m, rel=0.1)


def test_a_direction_of_the_sun_with_its_sign_flipped_is_named(painted, photographs):
    flipped = replace(
        photographs[0],
        sun=(painted.grid.axes @ photographs[0].sun * [-1, -1, 1]) @ painted.grid.axes,
    )
    found = solved(painted, [flipped, *photographs[1:]], FEW_ROUNDS)
    assert [fit.fit for fit in found.images] == [Fit.SUN_REVERSED, *[Fit.USED] * 5]


def test_suns_that_are_all_flipped_make_the_light_doubtful(painted, photographs):
    turn = painted.grid.axes.T @ np.diag([-1.0, -1.0, 1.0]) @ painted.grid.axes
    flipped = [replace(image, sun=turn @ image.sun) for image in photographs]
    right, wrong = (solved(painted, images, FEW_ROUNDS) for images in (photographs, flipped))
    assert right.light_ratio > 1.02
    assert wrong.light_ratio == pytest.approx(1.0 / right.light_ratio, rel=0.02)


def test_a_state_that_looks_away_does_not_disturb_the_others(painted, photographs):
    away = replace(photographs[0], axes=photographs[0].axes * [[1.0], [-1.0], [-1.0]])
    found = solved(painted, [away, *photographs[1:]], FEW_ROUNDS)
    assert [fit.fit for fit in found.images] == [Fit.NOT_SEEN, *[Fit.USED] * 5]
    assert np.std(inner(found.maplet.height - painted.heights())) < 0.02 * painted.heights().std()


def test_images_of_other_ground_are_named_and_little_harm_is_done(painted, photographs):
    other = replace(photographs[3], pixels=photographs[3].pixels[::-1, ::-1].copy())
    found = solved(painted, [*photographs[:3], other, *photographs[4:]], FEW_ROUNDS)
    assert [fit.name for fit in found.images if fit.fit is not Fit.USED] == ["I3"]


@pytest.mark.parametrize("kind", ["points", "means", "shared"])
def test_sigmas_grow_where_the_surface_bends(painted, photographs, kind):
    """Most where images alone show it: a height measures the top of a boulder within two cells.

    A height that shares its error with others, as of a shape, is none of relief of single cells.
    """
    height = np.full(painted.grid.shape, np.nan)
    height[20, 20] = painted.heights()[20, 20]
    common = 4.0 if kind == "shared" else 1.0
    one = HeightConstraint.of_sigma("one", height, 0.1, common=common)
    if kind == "means":
        one = replace(one, blur=np.full(height.shape, painted.grid.gsd**2 / 12.0))
    names = (
        "bend_sigma", "top_sigma", "measured_bend_sigma", "measured_top_sigma", "averaged_top_sigma"
    )  # fmt: skip
    without = replace(FEW_ROUNDS, **dict.fromkeys(names, 1e-9))
    plain = solved(painted, photographs, without, constraints=[one]).maplet
    found = solved(painted, photographs, FEW_ROUNDS, constraints=[one]).maplet
    np.testing.assert_array_equal(found.height, plain.height)
    y, x = np.indices(height.shape)
    near = np.hypot(y - 20, x - 20) <= 2.0
    measured = {
        "points": (FEW_ROUNDS.measured_bend_sigma, FEW_ROUNDS.measured_top_sigma),
        "means": (FEW_ROUNDS.measured_bend_sigma, FEW_ROUNDS.averaged_top_sigma),
        "shared": (FEW_ROUNDS.bend_sigma, FEW_ROUNDS.top_sigma),
    }
    bent, measured = measured[kind]
    bent = np.where(np.isfinite(height), bent, FEW_ROUNDS.bend_sigma)
    top = np.where(near, measured, FEW_ROUNDS.top_sigma)
    bend = bending_around(found.height)
    # Bending of ordinary ground is no boulder's.
    excess = np.sqrt(np.maximum(bend**2 - (1.5 * np.median(bend)) ** 2, 0.0))
    assert 0.05 < np.mean(excess[~near] > 0.0) < 0.5
    assert np.any(excess[near] > 0.0)
    added = np.hypot(bent * bend, top * excess)
    np.testing.assert_allclose(found.sigma, np.hypot(plain.sigma, added))


class Boulder(Painted):
    """A hill of 1.1 m on a plane, as steep as 0.9."""

    def height(self, x, y):
        return 1.1 * np.exp(-0.5 * (x**2 + y**2) / 0.75**2)

    def slopes(self, x, y):
        fall = -self.height(x, y) / 0.75**2
        return fall * x, fall * y

    def albedo(self, x, y):
        return np.ones_like(x)


def test_a_boulder_on_a_smooth_start_is_no_outlier(painted, monkeypatch):
    boulder = Boulder(replace(painted.grid, half_size=16))
    grid = boulder.grid
    images = [boulder.photograph(f"I{k}", *sight, size=60) for k, sight in enumerate(SIGHTS)]
    away = np.hypot(*np.meshgrid(grid.offsets, grid.offsets))
    around = HeightConstraint.of_sigma("around", np.where(away > 14, 0.0, np.nan), 0.01)

    def error():
        found = solved(boulder, images, FEW_ROUNDS, constraints=[around])
        return np.std(found.maplet.height - boulder.heights())

    slowly = error()
    monkeypatch.setattr("spcola.photometry.photoclinometry.surface_fit._WIDE", 1.0)
    # 0.018 and 0.026 m.
    assert slowly < 0.75 * error()


def test_steep_sides_of_a_boulder_are_hardly_drawn_to_a_smooth_start(painted):
    boulder = Boulder(replace(painted.grid, half_size=16))
    rng = np.random.default_rng(7)
    images = [boulder.photograph(f"I{k}", *SIGHTS[k], size=60) for k in (0, 1, 3)]
    noisy = [
        replace(one, pixels=one.pixels * rng.normal(1.0, 0.1, one.pixels.shape)) for one in images
    ]
    weak = replace(FEW_ROUNDS, slope_sigma=0.1)
    least, least_everywhere = (
        solved(boulder, noisy, options, constraints=[one_height(boulder)]).maplet.height
        - boulder.heights()
        for options in (weak, replace(weak, slope_loss_scale=1e6))
    )
    assert np.std(least) < 0.9 * np.std(least_everywhere), (np.std(least), np.std(least_everywhere))


def test_the_top_of_a_boulder_is_less_sure_and_the_plane_around_is_not(painted):
    boulder = Boulder(replace(painted.grid, half_size=16))
    away = np.hypot(*np.meshgrid(boulder.grid.offsets, boulder.grid.offsets))
    images = [boulder.photograph(f"I{k}", *sight, size=60) for k, sight in enumerate(SIGHTS)]
    with_top, without = (
        solved(boulder, images, options, constraints=[one_height(boulder)]).maplet.sigma
        for options in (FEW_ROUNDS, replace(FEW_ROUNDS, top_sigma=1e-9))
    )
    added = np.sqrt(with_top**2 - without**2)
    assert np.median(added[away < 1.5]) > 0.1
    assert np.median(added[away > 6.0]) == 0.0
    assert np.mean(added[away > 6.0]) < 0.003


def test_the_last_round_has_the_loss_that_is_asked_for(painted, photographs, monkeypatch):
    options = replace(FEW_ROUNDS, levels=(1,), rounds=1)
    one = solved(painted, photographs, options).maplet.height
    monkeypatch.setattr("spcola.photometry.photoclinometry.surface_fit._WIDE", 1.0)
    np.testing.assert_array_equal(solved(painted, photographs, options).maplet.height, one)


def test_cosmic_rays_and_saturated_pixels_do_not_matter(painted, photographs):
    rng = np.random.default_rng(1)
    struck = []
    for image in photographs:
        pixels = image.pixels.copy()
        pixels[rng.random(pixels.shape) < 0.01] = 60000
        pixels[rng.random(pixels.shape) < 0.01] = 65500
        struck.append(replace(image, pixels=pixels))
    clean = solved(painted, photographs, FEW_ROUNDS).maplet.height
    found = solved(painted, struck, FEW_ROUNDS).maplet.height
    assert np.std(inner(found - clean)) < 0.01


def test_coarser_images_never_make_the_finest_worse(painted, photographs):
    coarse = [
        painted.photograph(f"C{k}", toward, sun, pixel=1.5, size=40)
        for k, (toward, sun) in enumerate(SIGHTS)
    ]

    truth = np.array(slopes_of(painted.heights(), 0.5))

    def wrong(images):
        height = solved(painted, images, FEW_ROUNDS).maplet.height
        return np.std(inner(np.array(slopes_of(height, 0.5)) - truth))

    fine = wrong(photographs)
    assert wrong([*photographs, *coarse]) < 1.05 * fine
    # Their pixels are three cells wide: that the model spreads cells over pixels sharpens them.
    assert wrong(coarse) < 0.1 * np.std(truth)


@pytest.mark.parametrize(("noise", "most"), [(0.0, 1.06), (0.02, 1.0)])
def test_strongly_oblique_images_do_not_make_others_worse(waves, noise, most):
    """From 65 degrees aside pixels are 1.2 m long along the ground. With noise they help."""
    rng = np.random.default_rng(1)

    def seen(toward, sun, name):
        image = waves.photograph(name, toward, sun, pixel=0.5, size=90)
        factor = 1.0 + noise * rng.normal(size=image.pixels.shape)
        return replace(image, pixels=np.rint(image.pixels * factor).astype(np.uint16))

    above = [seen(*sight, f"I{k}") for k, sight in enumerate(SIGHTS[:4])]
    aside = np.tan(np.radians(65.0)) * np.array([[0.96, 0.3], [-0.8, 0.6]])
    suns = [-0.5, 0.4, 0.8], [0.5, 0.5, 0.8]
    oblique = [
        seen([*one, 1.0], sun, f"O{k}")
        for k, (one, sun) in enumerate(zip(aside, suns, strict=True))
    ]
    options = replace(FEW_ROUNDS, least_error=0.01)
    alone, with_oblique = (
        slope_error(waves, solved_flat(waves, images, options))
        for images in (above, [*above, *oblique])
    )
    assert with_oblique < most * alone


def test_too_few_images_keep_the_start(painted, photographs):
    found = solved(painted, photographs[:1], FEW_ROUNDS)
    assert found.outcome is Outcome.TOO_FEW_IMAGES
    assert found.kept_start
    np.testing.assert_array_equal(found.maplet.height, 0.0)
    assert "1 of 1 images" in found.reason
    dark = [replace(image, thresholds=(64000, 65000)) for image in photographs]
    found = solved(painted, dark, FEW_ROUNDS)
    assert found.outcome is Outcome.TOO_FEW_IMAGES
    assert {fit.fit for fit in found.images} == {Fit.NOT_SEEN}


# What a single image shows of heights makes them better, but does not count in their sigmas.
@pytest.mark.parametrize(("count", "least_pull"), [(0, 0.85), (1, 0.5)])
def test_heights_determine_ground_that_images_do_not_show(painted, photographs, count, least_pull):
    truth = painted.heights()
    noise = np.random.default_rng(5).normal(0.0, 0.02, truth.shape)
    heights = HeightConstraint.of_sigma("all", truth + noise, 0.02)
    found = solved(painted, photographs[:count], FEW_ROUNDS, constraints=[heights])
    assert found.outcome is Outcome.CONVERGED
    error = found.maplet.height - truth
    assert np.std(error) < 0.02
    assert least_pull < np.std(error / found.maplet.sigma) < 1.1
    assert not (found.directions == 2).any()
    if not count:
        np.testing.assert_array_equal(found.maplet.albedo, 1.0)
        assert np.isnan(found.albedo_sigma).all()


def test_light_along_the_ground_determines_no_heights(painted, photographs):
    """With the Sun 10 degrees high relief and scale are confused: shadows hide one side of it."""
    low = [
        painted.photograph(f"L{k}", toward, [*np.cos([k, k - np.pi / 2]), 0.18], size=90)
        for k, (toward, _) in enumerate(SIGHTS[:4])
    ]
    alone = solved(painted, low, FEW_ROUNDS)
    assert alone.outcome is Outcome.TOO_FEW_IMAGES
    assert "4 of 4 images" in alone.reason
    assert "0 with the Sun 20° high" in alone.reason
    np.testing.assert_array_equal(alone.maplet.height, 0.0)
    heights = HeightConstraint.of_sigma("all", painted.heights(), 0.1)
    right = replace(FEW_ROUNDS, contrast_sigma=1e-6)
    constrained = solved(painted, low, right, constraints=[heights])
    assert not constrained.kept_start
    # What such images show of heights does not count in their sigmas.
    high = solved(painted, photographs, right, constraints=[heights])
    assert np.median(constrained.maplet.sigma) > 2.0 * np.median(high.maplet.sigma)


def test_ground_that_nothing_shows_stays_unknown(painted, photographs):
    start = np.zeros(painted.grid.shape)
    start[:20, :20] = np.nan
    dark = []
    for image in photographs:
        line, pixel = np.indices(image.pixels.shape)
        hidden = project_hole(image, painted.grid, line, pixel)
        dark.append(replace(image, pixels=np.where(hidden, 0, image.pixels).astype(np.uint16)))
    # A .MAP has no albedo where a height is missing.
    albedo = np.where(np.isnan(start), np.nan, 0.5)
    half = replace(FEW_ROUNDS, convention=AlbedoConvention.published(0.5))
    found = solve_photoclinometry(
        Maplet("HOLE", painted.grid, start, albedo), dark, known_states(dark), options=half,
        constraints=[one_height(painted)],
    )  # fmt: skip
    assert np.isfinite(found.maplet.albedo).all()
    assert np.mean(found.maplet.albedo) == pytest.approx(0.5, abs=0.02)
    assert np.isnan(found.maplet.height[2:12, 2:12]).all()
    assert np.isnan(found.slope_sigma[:, 2:12, 2:12]).all()
    assert np.isfinite(found.slope_sigma[:, 25:, 25:]).all()
    assert (found.directions[2:12, 2:12] == 0).all()
    # The albedo of the field, not of images.
    assert np.isnan(found.albedo_sigma[4:12, 4:12]).all()
    assert np.isnan(found.point_albedo_sigma[5:12, 5:12]).all()
    assert np.median(found.albedo_sigma[25:-1, 25:-1]) / 0.5 < 0.02
    assert np.isfinite(found.albedo_sigma[25:-1, 25:-1]).all()
    assert np.isfinite(found.maplet.height[25:, 25:]).all()


def project_hole(image, grid, line, pixel):
    """Whether pixels lie within the projection of the grid's first 18 rows and columns."""
    steps = np.linspace(-30, -12, 60) * grid.gsd
    places = grid.center + steps[:, None, None] * grid.uy + steps[None, :, None] * grid.ux
    column, row = project_image(image, places)
    hole = np.zeros(line.shape, dtype=bool)
    hole[np.rint(row).astype(int) - 1, np.rint(column).astype(int) - 1] = True
    return ndimage.binary_closing(hole, iterations=2)


def test_input_without_heights_or_pixels_is_refused(painted, photographs):
    empty = Maplet("NONE", painted.grid, np.full(painted.grid.shape, np.nan))
    with pytest.raises(InvalidValueError, match="no height to start from"):
        solve_photoclinometry(empty, photographs, known_states(photographs))
    blank = replace(photographs[0], pixels=None)
    with pytest.raises(InvalidValueError, match="has no pixels"):
        solve_photoclinometry(flat(painted.grid), [blank], known_states([blank]))


@pytest.mark.parametrize(
    ("name", "value"),
    [("levels", (4, 2)), ("levels", (1, 2, 1)), ("rounds", 0), ("psf_px", -1.0),
     ("slope_sigma", 0.0), ("loss_scale", float("nan")), ("constraint_fraction", 0.0),
     ("constraint_fraction", 1.5)],
)  # fmt: skip
def test_options_out_of_range_are_refused(name, value):
    with pytest.raises(SettingsError):
        PhotoclinometryOptions(**{name: value})


def test_observed_and_expected_brightness_agree_on_the_grid(painted, photographs, noiseless):
    fits = {fit.name: fit for fit in noiseless.images}
    for image in photographs[:2]:
        fit = fits[image.name]
        shown = Comparison.on_grid(
            noiseless.maplet, image, shift_px=fit.shift_px, gradient=fit.gradient, options=NOISELESS
        )
        assert np.isfinite(shown.observed).mean() > 0.95
        # The albedo of points, as a maplet has it, is that of cells smoothed.
        assert np.nanstd(shown.residual) < 0.01
        away = image.position - painted.grid.center
        slant = float(painted.grid.uz @ away / np.linalg.norm(away))
        assert fit.pixel_m == pytest.approx(0.5 / np.sqrt(slant), rel=0.02)
        place = np.stack(project_image(image, painted.grid.points(painted.heights()))[::-1])
        # Places are those of the truth, and many lie at the edges of pixels: one of four it is.
        line, sample = np.floor(place).astype(int) - 1
        around = [image.pixels[line + down, sample + over] for down in (0, 1) for over in (0, 1)]
        seen = np.isfinite(shown.observed)
        assert (shown.observed == np.stack(around)).any(axis=0)[seen].mean() > 0.99
        unlike = Comparison.on_grid(flat(painted.grid), image, options=NOISELESS)
        assert np.nanstd(unlike.residual) > 0.05


def test_noise_is_separated_from_what_the_surface_does_not_explain(painted, photographs):
    rng = np.random.default_rng(2)
    noisy = [
        replace(image, pixels=np.rint(image.pixels * (1.0 + 0.02 * rng.normal(size=(90, 90)))))
        for image in photographs
    ]
    # The flat start explains none of the waves, whose residuals neighbours share.
    start = solved(painted, noisy[:1], FEW_ROUNDS)
    assert start.outcome is Outcome.TOO_FEW_IMAGES
    assert start.images[0].noise == pytest.approx(0.02, rel=0.15)
    assert start.images[0].residual > 3.0 * start.images[0].noise
    for fit in solved(painted, noisy, FEW_ROUNDS).images:
        assert fit.residual == pytest.approx(fit.noise, rel=0.2)


def test_an_image_that_looks_away_has_nothing_to_compare(painted, photographs):
    away = replace(photographs[0], axes=photographs[0].axes * [[1.0], [-1.0], [-1.0]])
    assert Comparison.on_grid(flat(painted.grid), away, options=NOISELESS) is None
    blank = replace(photographs[0], pixels=None)
    with pytest.raises(InvalidValueError, match="has no pixels"):
        Comparison.on_grid(flat(painted.grid), blank)
