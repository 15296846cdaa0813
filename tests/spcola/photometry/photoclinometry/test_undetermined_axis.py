"""Along which axis slopes are not determined: planted lights, and planted axes."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.grids import Maplet, MapletGrid
from spcola.photometry.functions import lambert
from spcola.photometry.photoclinometry import (
    Outcome,
    PhotoclinometryOptions,
    solve_photoclinometry,
)
from spcola.photometry.photoclinometry.undetermined_axis import UndeterminedAxis, cell_azimuths

OPTIONS = PhotoclinometryOptions(function=lambert, least_error=1e-3, settled_gsd=5e-3)
TOWARD = ([0.3, 0.0, 1.0], [-0.4, 0.2, 1.0], [0.0, 0.4, 1.0], [0.1, -0.4, 1.0])
KNOWN = 1e-14 * np.eye(6)


def sun_at(angle_deg):
    """A Sun 45° high, by its angle from Ux towards Uy."""
    angle = np.radians(angle_deg)
    return [np.cos(angle), np.sin(angle), 1.0]


def solved(painted, suns):
    images = [
        painted.photograph(f"I{k}", toward, sun, size=90)
        for k, (toward, sun) in enumerate(zip(TOWARD, suns, strict=False))
    ]
    start = Maplet("FLAT", painted.grid, np.zeros(painted.grid.shape))
    states = {image.name: KNOWN for image in images}
    return solve_photoclinometry(start, images, states, options=OPTIONS)


def apart(one, other, period=180.0):
    """How far two axes differ, in the unit of their period."""
    return abs((one - other + 0.5 * period) % period - 0.5 * period)


@pytest.mark.parametrize("angle_deg", [45.0, 250.0])
def test_slopes_across_a_single_sun_are_not_determined(painted, angle_deg):
    found = solved(painted, [sun_at(angle_deg)] * 3)
    axis = found.undetermined_axis
    assert apart(np.degrees(axis.angle), angle_deg + 90.0) < 2.0
    assert axis.agreement > 0.95
    assert axis.share == np.mean(found.directions == 1)
    # Sigmas of slopes along the axes of the grid do not show it.
    sigmas = np.nanmedian(found.slope_sigma, axis=(1, 2))
    assert angle_deg != 45.0 or sigmas[0] / sigmas[1] == pytest.approx(1.0, abs=0.1)
    # Ux is south and Uy east here: the azimuth of a direction is 180° less its angle.
    assert apart(axis.azimuth_deg, 90.0 - angle_deg) < 2.0
    one = found.directions == 1
    np.testing.assert_array_equal(np.isfinite(found.undetermined_azimuth_deg), one)
    cells = found.undetermined_azimuth_deg[one]
    assert ((cells >= 0.0) & (cells < 180.0)).all()
    # The axis of the maplet is the mean of those of its cells.
    mean = np.mean(np.exp(2j * np.radians(cells)))
    assert abs(mean) == pytest.approx(axis.agreement)
    assert apart(0.5 * np.degrees(np.angle(mean)), axis.azimuth_deg) < 1e-6
    assert found.outcome is Outcome.UNDETERMINED
    stated = f"along azimuth {round(axis.azimuth_deg)}° (from north to east) are not determined"
    assert stated in found.reason
    assert f"in {axis.share:.0%} of the cells, those across it are" in found.reason


def test_with_two_suns_at_right_angles_there_is_no_axis(painted):
    found = solved(painted, [sun_at(45.0), sun_at(45.0), sun_at(135.0), sun_at(135.0)])
    assert (found.directions == 2).mean() > 0.8
    assert not found.undetermined_axis.known
    assert np.isnan(found.undetermined_axis.azimuth_deg)
    assert "azimuth" not in found.reason


def test_without_images_there_is_no_axis(painted):
    found = solved(painted, [])
    assert found.outcome is Outcome.TOO_FEW_IMAGES
    assert not found.undetermined_axis.known
    assert np.isnan(found.undetermined_axis.agreement)
    assert np.isnan(found.undetermined_azimuth_deg).all()
    assert found.undetermined_azimuth_deg.shape == found.directions.shape


def information(angles):
    """That on slopes of cells (N, 1) across axes at the angles, with 1 % along them."""
    x, y = -np.sin(angles), np.cos(angles)
    own = np.stack([x * x, x * y, y * y]) + 0.01 * np.array([1.0, 0.0, 1.0])[:, None]
    return own[..., None]


def axis_of(angles, grid=None):
    grid = grid or MapletGrid.facing([0.0, 250.0, 0.0], [0.0, 1.0, 0.0], 0.5, 2)
    return UndeterminedAxis.of(information(angles), np.ones((len(angles), 1), np.bool_), grid)


def test_axes_are_the_same_after_half_a_turn():
    angles = np.radians(np.tile([1.0, 181.0, 179.0, -1.0], 5))
    axis = axis_of(angles)
    assert apart(axis.angle, 0.0, np.pi) < 1e-9
    assert axis.agreement == pytest.approx(np.cos(np.radians(2.0)))
    assert axis.shown_azimuth == "0°"


def test_each_cell_with_one_direction_has_its_own_axis():
    grid = MapletGrid.facing([0.0, 250.0, 0.0], [0.0, 1.0, 0.0], 0.5, 2)
    angles = np.radians([10.0, 100.0, 190.0, 55.0])
    one = np.array([[True], [True], [True], [False]])
    found = cell_azimuths(information(angles), one, grid)
    # Ux is south and Uy east here.
    np.testing.assert_allclose(found[:3, 0], [170.0, 80.0, 170.0])
    assert np.isnan(found[3, 0])


@pytest.mark.parametrize("agreement", [0.79, 0.81])
def test_of_axes_that_disagree_there_is_no_mean(agreement):
    # Half of the cells to either side.
    aside = 0.5 * np.arccos(agreement)
    axis = axis_of(np.array([0.3 - aside, 0.3 + aside] * 10))
    assert axis.agreement == pytest.approx(agreement)
    assert axis.known == (agreement > 0.8)
    assert axis.angle == pytest.approx(0.3 if agreement > 0.8 else np.nan, nan_ok=True)


def test_a_few_cells_show_nothing_of_the_maplet():
    assert not axis_of(np.full(9, 0.3)).known
    assert axis_of(np.full(9, 0.3)).agreement == pytest.approx(1.0)
    assert axis_of(np.full(10, 0.3)).known


@pytest.mark.parametrize("turn_deg", [0.0, 30.0, 200.0])
def test_the_azimuth_does_not_depend_on_the_axes_of_the_grid(turn_deg):
    """An axis at azimuth 60° on a maplet tilted from the direction of its centre."""
    up = np.array([0.5, 0.7, 0.4]) / np.sqrt(0.9)
    north = np.array([0.0, 0.0, 1.0]) - up[2] * up
    north /= np.linalg.norm(north)
    east = np.cross(north, up)
    turn = np.radians(turn_deg)
    ux = np.cos(turn) * north + np.sin(turn) * east
    grid = MapletGrid([0.0, 250.0, 0.0], [ux, np.cross(up, ux), up], 0.5, 2)
    along = np.cos(np.radians(60.0)) * north + np.sin(np.radians(60.0)) * east
    axis = axis_of(np.full(10, np.arctan2(along @ grid.uy, along @ grid.ux)), grid)
    assert axis.azimuth_deg == pytest.approx(60.0)
