"""False echoes in the gaps of rasters are rejected at every density; shots of tracks are kept."""

from __future__ import annotations

import numpy as np
import pytest

from lidar.gridding import grid_returns
from lidar.gridding.rejection.density import is_dense
from lidar.scans import Returns
from spcola.grids import MapletGrid

GRID = MapletGrid.facing([200.0, 50.0, 30.0], [1.0, 0.2, 0.1], 0.1, 30)
X, Y = np.meshgrid(GRID.offsets * GRID.gsd, GRID.offsets * GRID.gsd)
SIGMA = 0.01


def ground(x, y):
    return 0.3 * x + 0.5 * np.sin(1.3 * x) * np.cos(y)


def lifted(x, y, height):
    """Points at `height` over places in grid steps."""
    return (
        GRID.center
        + GRID.gsd * (x[:, None] * GRID.ux + y[:, None] * GRID.uy)
        + (height[:, None] * GRID.uz)
    )


def measured(x, y, rng):
    """Points of the ground with the noise of a return."""
    height = ground(x * GRID.gsd, y * GRID.gsd)
    return lifted(x, y, height + SIGMA * rng.normal(size=len(x)))


def raster(per_cell, rng):
    """Returns of a raster with a belt and a round gap that it does not cover."""
    x, y = rng.uniform(-30.5, 30.5, (2, int(per_cell * 61**2)))
    belt = np.abs(x + 0.35 * y) < 6.0
    return measured(*np.stack([x, y])[:, ~belt & (np.hypot(x - 18, y - 14) > 8)], rng)


def false_echoes(count, rng):
    """Points anywhere on the grid, up to 25 GSD above and below its plane."""
    return lifted(*rng.uniform([-30, -30, -2.5], [30, 30, 2.5], (count, 3)).T)


def together(*scans):
    count = [len(points) for points in scans]
    sigma, scan = np.full(sum(count), SIGMA), np.repeat(range(len(scans)), count)
    return Returns(np.concatenate(scans), sigma, scan, tuple("abcdef"[: len(scans)]))


def departures(points):
    x, y, height = GRID.project(points)
    return np.abs(height - ground(x * GRID.gsd, y * GRID.gsd))


@pytest.mark.parametrize("per_cell", [1, 2, 4, 10])
def test_false_echoes_in_gaps_are_rejected_at_every_density(per_cell):
    good = lost = gross = kept = 0
    errors, pulls = [], []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        ground_points = raster(per_cell, rng)
        echoes = false_echoes(37 * per_cell, rng)
        gridding = grid_returns("A", GRID, together(np.concatenate([ground_points, echoes])))
        used = gridding.used[len(ground_points) :]
        far = departures(echoes) > 3 * GRID.gsd
        good, lost = good + len(ground_points), lost + np.count_nonzero(~gridding.used) - sum(~used)
        gross, kept = gross + far.sum(), kept + (used & far).sum()
        error = (gridding.mapola.height - ground(X, Y))[gridding.mapola.valid]
        errors.append(error)
        pulls.append(np.abs(error) / gridding.mapola.sigma[gridding.mapola.valid])
    errors, pulls = np.concatenate(errors), np.concatenate(pulls)
    assert gross > 100 * per_cell
    assert kept == 0
    assert lost < 0.003 * good
    # What is left is within reach of a slope from one cell to the next.
    assert np.abs(errors).max() < 4 * GRID.gsd
    assert np.sqrt(np.mean(errors**2)) < 1.1 * SIGMA
    assert np.mean(pulls < 1) == pytest.approx(0.683, abs=0.015)
    assert np.mean(pulls < 2) == pytest.approx(0.954, abs=0.01)
    assert np.mean(pulls > 5) < 2e-3


def test_lone_shots_of_a_track_are_kept_where_false_echoes_of_a_raster_are_not():
    rng = np.random.default_rng(6)
    along = np.arange(-30.0, 31.0, 3.0)
    track = measured(along + rng.uniform(-0.3, 0.3, len(along)), 0.4 * along, rng)
    points = raster(2, rng)
    echoes = false_echoes(60, rng)
    returns = together(np.concatenate([points, echoes]), track)
    gridding = grid_returns("A", GRID, returns)
    far = departures(echoes) > 3 * GRID.gsd
    assert not gridding.used[len(points) : -len(track)][far].any()
    assert gridding.used[-len(track) :].all()


def test_false_echoes_of_a_raster_beyond_the_grid_are_no_track():
    rng = np.random.default_rng(7)
    points = raster(2, rng)
    # All that the second scan leaves on this grid.
    echoes = false_echoes(30, rng)
    gridding = grid_returns("A", GRID, together(points, echoes))
    far = departures(echoes) > 3 * GRID.gsd
    assert not gridding.used[len(points) :][far].any()
    assert gridding.used[: len(points)].mean() > 0.999


def test_a_false_echo_beyond_a_strip_of_a_raster_at_the_edge_of_the_grid_is_rejected():
    """The strip alone looks like a track, but a lone return is far from it."""
    rng = np.random.default_rng(8)
    other = raster(2, rng)
    strip = measured(rng.uniform(-30, 0, 90), rng.uniform(29.6, 30.4, 90), rng)
    echo = lifted(np.array([0.5]), np.array([0.0]), np.array([-2.0]))
    gridding = grid_returns("A", GRID, together(other, np.concatenate([strip, echo])))
    assert not gridding.used[-1]
    assert gridding.used[:-1].mean() > 0.999


@pytest.mark.parametrize("step", [0.4, 1.5, 4.0, 11.0])
def test_tracks_and_single_shots_lose_nothing(step):
    rng = np.random.default_rng(9)
    along = np.arange(-30.0, 30.4, step)
    # One with a wide gap and a shot in the middle of it.
    broken = along[(np.abs(along) > 8) | (np.abs(along) < 0.05)]
    tracks = [
        measured(broken, 0.3 * broken - 10.0, rng),
        measured(along, 0.3 * along + 6.0, rng),
        # One shot alone.
        measured(np.array([-20.0]), np.array([25.0]), rng),
    ]
    gridding = grid_returns("A", GRID, together(*tracks))
    assert gridding.used.all()


def test_the_order_of_returns_and_scans_does_not_matter():
    rng = np.random.default_rng(10)
    along = np.arange(-30.0, 31.0, 3.0)
    scans = [raster(1, rng), measured(along, 0.4 * along, rng), false_echoes(60, rng)]
    returns = together(*scans)
    order = rng.permutation(len(returns))
    turned = Returns(
        returns.points[order], returns.sigma[order], 2 - returns.scan[order], ("c", "b", "a")
    )
    one, other = grid_returns("A", GRID, returns), grid_returns("A", GRID, turned)
    assert one.report == other.report
    assert np.array_equal(one.used[order], other.used)
    assert np.array_equal(one.mapola.height, other.mapola.height, equal_nan=True)


def test_rasters_are_dense_and_tracks_are_not():
    rng = np.random.default_rng(11)
    one = rng.poisson(1.0, (61, 61))
    assert is_dense(one, 4, 2)
    assert not is_dense(rng.poisson(0.1, (61, 61)), 4, 2)
    # Across corners: the most that a straight track can cross.
    track = np.eye(61, dtype=int) + np.eye(61, k=1, dtype=int)
    assert not is_dense(track, 4, 2)
    # What the edge of the grid leaves of a raster.
    assert is_dense(one[:, :3], 4, 2)
    assert is_dense(np.where(np.arange(61) < 3, one, 0), 4, 2)
    # Many returns in each cell of a track are a raster of it.
    assert is_dense(5 * track, 4, 2)
    assert not is_dense(0 * track, 4, 2)
