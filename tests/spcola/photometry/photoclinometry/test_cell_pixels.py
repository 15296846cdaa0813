"""Cells in pixels: areas, derivatives, and the gradient of the squared residuals."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.photometry.functions import PHOTOMETRIC_FUNCTIONS, photometric_function
from spcola.photometry.image_blur import ImageBlur
from spcola.photometry.photoclinometry.cell_pixels import (
    box_cells,
    gather_cells,
    multiply_nuisances,
    shade_cells,
    sharpen_cells,
    spread_cells,
)

RNG = np.random.default_rng(3)
CELLS = (7, 9)


def shades_of(name, slopes, gradient=(0.0, 0.0), irradiance=1.0):
    function = photometric_function(name)
    sun = np.array([0.5, -0.3, 0.8])
    sun /= np.linalg.norm(sun)
    eye = np.broadcast_to(np.array([-0.2, 0.4, 0.9])[:, None, None], (3, *CELLS)).copy()
    eye /= np.linalg.norm(eye, axis=0)
    phase = np.arccos(np.tensordot(sun, eye, 1))
    found = np.zeros((3, *CELLS))
    chosen = int(function.code), function.packed
    light = sun, phase, np.full(CELLS, irradiance)
    shade_cells(chosen, slopes, light, eye, np.array(gradient), found)
    return found


@pytest.mark.parametrize("name", sorted(PHOTOMETRIC_FUNCTIONS))
def test_derivatives_by_slopes_are_those_of_finite_differences(name):
    slopes, step = RNG.normal(0.0, 0.2, (2, *CELLS)), 1e-6
    found = shades_of(name, slopes)
    for axis in range(2):
        moved = np.zeros((2, 1, 1))
        moved[axis] = step
        change = shades_of(name, slopes + moved)[0] - shades_of(name, slopes - moved)[0]
        np.testing.assert_allclose(found[1 + axis], change / (2 * step), rtol=1e-5, atol=1e-7)


def test_a_gradient_changes_brightness_from_the_centre_to_the_edge():
    slopes = RNG.normal(0.0, 0.2, (2, *CELLS))
    ratio = shades_of("lambert", slopes, (0.3, -0.2)) / shades_of("lambert", slopes)
    y, x = ((np.arange(size) + 0.5) * 2 / size - 1 for size in CELLS)
    np.testing.assert_allclose(ratio, [1.0 + 0.3 * x - 0.2 * y[:, None]] * 3)
    faint = shades_of("lambert", slopes, irradiance=0.1)
    np.testing.assert_allclose(faint, 0.1 * shades_of("lambert", slopes))


def places(*, tilt=0.3, pixel=0.7):
    """Sample and line of points: turned, oblique, a cell is `pixel` wide."""
    y, x = np.indices((CELLS[0] + 1, CELLS[1] + 1)).astype(float)
    height = RNG.normal(0.0, 0.1, x.shape)
    u = 4.0 + pixel * (x * np.cos(tilt) - y * np.sin(tilt)) + 0.3 * height
    v = 4.0 + pixel * (x * np.sin(tilt) + 0.8 * y * np.cos(tilt)) - 0.2 * height
    return u, v


def boxes_of(where, seen=1.0, facing=1.0):
    boxes = np.empty((5, *CELLS))
    box_cells(*where, facing, np.full(CELLS, seen), boxes)
    return boxes


def spread(boxes, albedo, lit=1.0, shape=(20, 20)):
    sums = np.zeros((3, *shape))
    spread_cells(boxes, lit * albedo, np.full(CELLS, lit), sums)
    return sums


def sharpened(light, whole=1.0):
    sharp = np.empty(light.shape)
    sharpen_cells(light, np.broadcast_to(whole, light.shape).astype(float), sharp)
    return sharp


def test_light_is_conserved_and_ground_seen_evenly_is_even():
    (u, v), albedo = places(), RNG.uniform(0.5, 1.5, CELLS)
    sums = spread(boxes_of((u, v)), albedo)
    diagonals = (u[1:, 1:] - u[:-1, :-1]) * (v[1:, :-1] - v[:-1, 1:])
    diagonals -= (v[1:, 1:] - v[:-1, :-1]) * (u[1:, :-1] - u[:-1, 1:])
    area = 0.5 * np.abs(diagonals)
    assert sums[0].sum() == pytest.approx(area.sum(), rel=2e-3)
    assert sums[1].sum() == pytest.approx((area * albedo).sum(), rel=5e-3)
    assert not sums[2].any()


def test_cells_partly_in_shadow_or_hidden_give_part_of_their_light():
    boxes, albedo = boxes_of(places()), RNG.uniform(0.5, 1.5, CELLS)
    whole, half = spread(boxes, albedo), spread(boxes, albedo, lit=0.5)
    np.testing.assert_allclose(half, [whole[0], 0.5 * whole[1], whole[0]])
    behind = spread(boxes_of(places(), seen=0.25), albedo)
    assert behind[0].sum() == pytest.approx(0.25 * whole[0].sum(), rel=1e-2)
    assert not spread(boxes_of(places(), facing=-1.0), albedo).any()


def test_square_cells_have_their_exact_overlaps_with_pixels():
    y, x = np.indices((CELLS[0] + 1, CELLS[1] + 1)).astype(float)
    sums = spread(boxes_of((2.25 + 0.5 * x, 3.0 + 0.5 * y)), np.ones(CELLS))
    assert sums[0][4, 4] == pytest.approx(1.0)
    assert sums[0][4, 2] == pytest.approx(0.75)
    assert sums[0].sum() == pytest.approx(0.25 * CELLS[0] * CELLS[1])


@pytest.mark.parametrize("cells_a_wave", [5.0, 8.0, 16.0])
@pytest.mark.parametrize("pixels_a_cell", [0.61, 1.37, 1.87])
def test_cells_do_not_take_contrast_from_waves_of_the_ground(cells_a_wave, pixels_a_cell):
    """Pixels see waves of slopes as the ground itself has them, to 3 % of their contrast."""
    number, wave = 200, 2 * np.pi / cells_a_wave
    corners = np.arange(number + 1.0)
    # Means of cos(wave x) over each cell, as its slopes are.
    light = np.tile(np.diff(np.sin(wave * corners)) / wave, (number, 1))
    y, x = np.meshgrid(pixels_a_cell * corners, pixels_a_cell * corners, indexing="ij")
    boxes = np.empty((5, number, number))
    box_cells(x, y, 1.0, np.ones((number, number)), boxes)
    edges = np.arange(int(pixels_a_cell * number) + 1.0) / pixels_a_cell
    truth = (np.diff(np.sin(wave * edges)) / wave * pixels_a_cell)[4:-4]

    def contrast(light):
        sums = np.zeros((3, len(edges) - 1, len(edges) - 1))
        spread_cells(boxes, light, np.ones(light.shape), sums)
        return (sums[1] / sums[0])[len(truth) // 2, 4:-4] @ truth / (truth @ truth)

    assert contrast(sharpened(light)) == pytest.approx(1.0, abs=0.03)
    # To second order two means over a cell take this of it.
    assert 1.0 - contrast(light) == pytest.approx(wave**2 / 12.0, rel=0.15)


def test_ground_at_the_edge_of_a_shadow_is_not_sharpened():
    light, whole = RNG.uniform(0.5, 1.5, CELLS), np.ones(CELLS)
    whole[:, 4] = 0.0
    sharp = sharpened(light, whole)
    np.testing.assert_array_equal(sharp[:, 4], light[:, 4])
    np.testing.assert_allclose(sharp[:, :4], sharpened(light[:, :4].copy()))
    assert sharp.sum() == pytest.approx(light.sum())
    np.testing.assert_allclose(sharpened(np.ones(CELLS)), 1.0)


@pytest.mark.parametrize(
    "blur", [ImageBlur(), ImageBlur(0.6), ImageBlur(0.0, (1.3, -2.1)), ImageBlur(0.9, (0.4, 3.0))]
)
def test_right_hand_side_is_the_gradient_of_the_squared_residuals(blur):
    """By slopes and albedo: of the sum of w r² over the pixels, exactly, however blurred."""
    boxes, slopes = boxes_of(places()), RNG.normal(0.0, 0.2, (2, *CELLS))
    albedo, scale = RNG.uniform(0.8, 1.2, CELLS), 3.0
    shades = shades_of("lunar-lambert", slopes)

    def seen(shades, albedo):
        return blur.applied(spread(boxes, albedo * shades[0]), (1, 2))

    sums = seen(shades, albedo)
    used = sums[0] > 0.6
    observed = RNG.uniform(0.5, 2.5, used.shape)

    def residuals(slopes, albedo):
        lit = seen(shades_of("lunar-lambert", slopes), albedo)
        return (observed - scale * lit[1] / np.maximum(lit[0], 1e-9))[used]

    left = residuals(slopes, albedo)
    window = np.zeros((*used.shape, 5))
    window[used, 0] = 1.0 / sums[0][used]
    window[used, 1] = left / sums[0][used]
    # As if all pixels were expected to be 1: the sum over cells is that over pixels then.
    window[used, 2] = 1.0 / sums[0][used]
    window = blur.applied(window, (0, 1))
    bright = np.full(CELLS, scale), albedo, shades
    own, factors, nuisance = np.zeros((14, *CELLS)), np.zeros((8, *CELLS)), np.zeros((6, 7))
    gather_cells(boxes, np.zeros((2, *CELLS)), window, bright, 0.7, (own, factors, nuisance))
    step = 1e-6
    for place in ((0, 0), (3, 4), (6, 8), (2, 7)):
        for unknown in (0, 1, 3):
            changed = []
            for sign in (1.0, -1.0):
                moved, bright = slopes.copy(), albedo.copy()
                if unknown == 3:
                    bright[place] += sign * step
                else:
                    moved[unknown][place] += sign * step
                changed.append(0.5 * np.sum(residuals(moved, bright) ** 2))
            gradient = -(changed[0] - changed[1]) / (2 * step)
            assert own[10 + unknown][place] == pytest.approx(gradient, rel=1e-5, abs=1e-8)
    assert nuisance[0, 6] == pytest.approx(np.sum(left))
    # Brightness added to every pixel.
    assert nuisance[5, 6] == pytest.approx(0.7 * np.sum(left))
    again = np.empty((1, 6, 6))
    multiply_nuisances(factors[None], again)
    np.testing.assert_allclose(again[0], nuisance[:, :6], rtol=1e-10, atol=1e-12)
