"""Matches on a round body whose maplets are half a radius wide: its roundness must not pull."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial.transform import Rotation

from fusion.surfacematch import Surface, match_surfaces
from fusion.surfacematch.resolution import blur, estimate_spectrum
from spcola.grids import MapletGrid
from spcola.grids.gaps import bridged

RADIUS = 40.0
GRID = MapletGrid.facing([0.0, 0.0, RADIUS], [0.0, 0.0, 1.0], 0.75, 27)


def bumps(direction, seed):
    """Relief (R, C), metres, in directions (R, C, 3): waves of 4 to 12 m."""
    generator = np.random.default_rng(seed)
    wave = generator.normal(size=(80, 3))
    wave *= generator.uniform(20.0, 60.0, (80, 1)) / np.linalg.norm(wave, axis=1, keepdims=True)
    phase = generator.uniform(0.0, 2.0 * np.pi, 80)
    return 0.2 * np.cos(direction @ wave.T + phase).sum(axis=-1) * np.sqrt(2.0 / 80)


@cache
def heights(seed, turn=(0.0, 0.0, 0.0), shift=(0.0, 0.0, 0.0)):
    """Heights of the body on the grid, turned by a rotation vector and then moved, metres."""
    back = Rotation.from_rotvec(turn).inv()
    height = np.zeros(GRID.shape)
    for _ in range(30):
        place = back.apply((GRID.points(height) - np.array(shift)).reshape(-1, 3))
        size = np.linalg.norm(place, axis=1)
        low = RADIUS + bumps(place / size[:, None], seed) - size
        height += 0.9 * low.reshape(GRID.shape)
    return height


def noisy(height, seed, *, spc):
    """Heights with noise: white of a lidar, or correlated over some cells as that of SPC."""
    generator = np.random.default_rng([seed, spc])
    noise = generator.normal(size=height.shape)
    if not spc:
        return height + 0.02 * noise
    noise = ndimage.gaussian_filter(noise, 2.5, mode="wrap")
    return blur(height, 1.2) + 0.05 * noise / noise.std()


def response(planted, *, filtered, lost=0.0, **move):
    """Found over planted displacement of lidar surfaces that `move`, and heights found, metres."""
    found, rise = [], []
    for seed in range(6):
        spc = noisy(heights(seed), seed, spc=True)
        lidar = [noisy(heights(seed, **how), seed, spc=False) for how in ({}, move)]
        spc[:, : int(lost * GRID.size)] = np.nan
        spectrum = None
        if filtered:
            first = match_surfaces("M", GRID, Surface(lidar[0]), Surface(spc), blur_cells=1.2)
            spectrum = estimate_spectrum([first.residual])
        still, moved = (
            match_surfaces("M", GRID, Surface(one), Surface(spc), blur_cells=1.2, spectrum=spectrum)
            for one in lidar
        )
        assert still.usable
        assert moved.usable
        path = still.displacement - moved.displacement
        found.append(path @ planted / (planted @ planted))
        rise.append(path @ GRID.uz)
    return np.mean(found), np.mean(rise)


@pytest.mark.parametrize("filtered", [False, True])
@pytest.mark.parametrize("cells", [0.25, 0.5])
def test_a_shift_of_part_of_a_cell_is_found_whole(filtered, cells):
    shift = cells * GRID.gsd * GRID.ux
    share, _ = response(shift, filtered=filtered, shift=tuple(shift))
    assert share == pytest.approx(1.0, abs=0.04)


@pytest.mark.parametrize("filtered", [False, True])
def test_a_rotation_about_the_centre_of_the_body_is_found_whole(filtered):
    # A globe looks alike however it is turned: only the relief shows the rotation.
    turn = np.radians(0.3) * GRID.uy
    path = np.cross(turn, GRID.center)
    share, rise = response(path, filtered=filtered, turn=tuple(turn))
    assert share == pytest.approx(1.0, abs=0.06)
    assert rise == pytest.approx(0.0, abs=0.003)


def test_an_edge_that_one_surface_lacks_does_not_lift_the_other():
    share, rise = response(
        np.array([0.3, 0.0, 0.0]), filtered=True, lost=0.06, shift=(0.3, 0.0, 0.0)
    )
    assert share == pytest.approx(1.0, abs=0.06)
    assert rise == pytest.approx(0.0, abs=0.003)


def test_wide_gaps_go_on_as_the_body_does():
    height = heights(1)
    lacking = height.copy()
    lacking[:, :12] = np.nan
    # Without its relief the body falls by 7 m over these columns.
    assert np.abs(bridged(lacking) - height).max() < 1.5
