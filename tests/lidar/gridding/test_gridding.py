"""Mapolas from returns: planted surfaces recovered, order, outliers, calibrated sigma."""

from __future__ import annotations

import numpy as np
import pytest

from lidar.gridding import GriddingOptions, Mapola, grid_returns, make_mapola
from lidar.gridding.rejection import RejectionOptions
from lidar.gridding.sigma import median_sigma
from lidar.scans import Returns, Scan
from spcola.errors import InvalidValueError, SettingsError
from spcola.grids import MapletGrid

GRID = MapletGrid.facing([200.0, 50.0, 30.0], [1.0, 0.2, 0.1], 0.1, 30)
X, Y = np.meshgrid(GRID.offsets * GRID.gsd, GRID.offsets * GRID.gsd)
KEEP_ALL = RejectionOptions.none()


def plane(x, y):
    return 0.5 + 0.3 * x - 0.2 * y


def rolling(x, y):
    return 0.3 * x + 0.5 * np.sin(1.3 * x) * np.cos(y)


def returns_on(surface, count, rng, *, noise=0.0, sigma=np.nan, outliers=0.0, grid=GRID):
    """Returns at random places of the grid, heights from `surface`, a share of them outliers."""
    x, y = rng.uniform(-grid.half_size - 0.5, grid.half_size + 0.5, (2, count))
    height = surface(x * grid.gsd, y * grid.gsd) + noise * rng.normal(size=count)
    outlier = rng.random(count) < outliers
    width = grid.half_size * grid.gsd
    height[outlier] = rng.uniform(-width, width, outlier.sum())
    points = lifted(grid, x, y, height)
    return Returns(points, np.full(count, sigma), np.zeros(count, dtype=np.int32), ("a",)), outlier


def lifted(grid, x, y, height):
    plane = grid.gsd * (x[:, None] * grid.ux + y[:, None] * grid.uy)
    return grid.center + plane + height[:, None] * grid.uz


@pytest.mark.parametrize("per_cell", [1.5, 4.0, 30.0])
@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.7, -0.4), (-3.0, 2.0)])
def test_a_plane_is_recovered_to_rounding(per_cell, tilt):
    rng = np.random.default_rng(10)

    def ground(x, y):
        return 0.2 + tilt[0] * x + tilt[1] * y

    returns, _ = returns_on(ground, int(per_cell * 61**2), rng)
    options = GriddingOptions(tolerance=1e-13, reach_m=100.0, rejection=KEEP_ALL)
    result = grid_returns("A", GRID, returns, options=options)
    error = np.abs(result.mapola.height - ground(X, Y))[result.mapola.valid]
    assert result.report.converged
    # Coordinates of 200 m are stored to 3e-14 m; slopes add up a few of these.
    assert error.max() < 1e-12


def test_one_return_in_each_cell_needs_one_round_on_a_plane():
    rng = np.random.default_rng(11)
    n, m = np.meshgrid(GRID.offsets, GRID.offsets)
    x = (n + rng.uniform(-0.499, 0.499, n.shape)).ravel()
    y = (m + rng.uniform(-0.499, 0.499, n.shape)).ravel()
    points = lifted(GRID, x, y, plane(x * GRID.gsd, y * GRID.gsd))
    returns = Returns(points, np.full(len(x), 0.01), np.zeros(len(x), dtype=int), ("a",))
    result = grid_returns("A", GRID, returns)
    assert result.report.iterations == 2  # the second finds that nothing changes
    assert np.abs(result.mapola.height - plane(X, Y)).max() < 1e-12


def test_returns_on_the_grid_points_keep_their_heights():
    points = GRID.points(rolling(X, Y)).reshape(-1, 3)
    returns = Returns(points, np.full(len(points), 0.01), np.zeros(len(points), dtype=int), ("a",))
    mapola = make_mapola("A", GRID, returns)
    assert np.abs(mapola.height - rolling(X, Y)).max() < 1e-12
    assert (mapola.count == 1).all()


def test_on_a_quadratic_the_median_errs_by_its_known_bias():
    """Slopes are exact; what is left of ½ a d² is its median over the cell, a s² / 32."""
    curvature = 0.8
    rng = np.random.default_rng(12)
    grid = MapletGrid.facing([200.0, 50.0, 30.0], [1.0, 0.2, 0.1], 0.1, 5)
    x, y = np.meshgrid(grid.offsets * grid.gsd, grid.offsets * grid.gsd)
    returns, _ = returns_on(lambda x, y: 0.5 * curvature * x**2 + 0.2 * y, 400_000, rng, grid=grid)
    options = GriddingOptions(rejection=KEEP_ALL)
    mapola = make_mapola("A", grid, returns, options=options)
    bias = mapola.height - (0.5 * curvature * x**2 + 0.2 * y)
    expected = curvature * grid.gsd**2 / 32
    # 3300 returns in a cell: the median of d² is known to 2 %; inside the rim slopes are exact.
    assert np.mean(bias[1:-1, 1:-1]) == pytest.approx(expected, rel=0.01)


def test_it_equals_a_reference_in_plain_numpy():
    rng = np.random.default_rng(13)
    grid = MapletGrid.facing([200.0, 50.0, 30.0], [1.0, 0.2, 0.1], 0.1, 5)
    returns, _ = returns_on(rolling, 240, rng, noise=0.01, grid=grid)
    options = GriddingOptions(rejection=KEEP_ALL, tolerance=1e-10)
    mapola = make_mapola("A", grid, returns, options=options)
    assert 0.05 < np.mean(mapola.count == 0) < 0.5
    assert np.nanmax(np.abs(Reference(returns.points, grid).settled() - mapola.height)) < 1e-9


class Reference:
    """Slope-corrected medians with loops, dictionaries and lstsq."""

    def __init__(self, points, grid):
        x, y, self.h = grid.project(points)
        self.size = grid.size
        self.x, self.y = x + grid.half_size, y + grid.half_size
        column, row = np.floor(self.x + 0.5), np.floor(self.y + 0.5)
        nodes = [(r, c) for r in range(grid.size) for c in range(grid.size)]
        found = {(r, c): np.flatnonzero((row == r) & (column == c)) for r, c in nodes}
        self.members = {k: v for k, v in found.items() if len(v)}
        self.place = {
            k: np.array([np.mean(self.x[v]), np.mean(self.y[v])]) for k, v in self.members.items()
        }
        self.windows = {k: self.window(k) for k in self.members}

    def window(self, cell):
        for radius in (1, 2, 3):
            near = [k for k in self.place if np.abs(np.subtract(k, cell)).max() <= radius]
            weight = [len(self.members[k]) / (len(self.members[k]) + 1) for k in near]
            scatter = np.cov(np.array([self.place[k] for k in near]).T, aweights=weight, ddof=0)
            if np.linalg.eigvalsh(scatter)[0] >= 0.3**2:
                return near
        raise AssertionError("this test has no cell that is so lonely")

    def slope(self, cell, value):
        near = self.windows[cell]
        weight = np.array([len(self.members[k]) for k in near], dtype=float)
        weight = np.sqrt(weight / (weight + 1))[:, None]
        places = np.array([self.place[k] for k in near]) - self.place[cell]
        design = np.column_stack([np.ones(len(near)), places])
        heights = np.array([[value[k]] for k in near])
        return np.linalg.lstsq(design * weight, heights * weight, rcond=None)[0][1:, 0]

    def settled(self):
        value = {k: np.median(self.h[v]) for k, v in self.members.items()}
        height = np.full((self.size, self.size), np.nan)
        slope = {k: np.zeros(2) for k in self.members}
        for round_number in range(100):
            share = 1.0 if round_number < 10 else 0.5
            slope = {k: slope[k] + share * (self.slope(k, value) - slope[k]) for k in slope}
            before = height.copy()
            for (r, c), v in self.members.items():
                tx, ty = slope[r, c]
                height[r, c] = np.median(self.h[v] + tx * (c - self.x[v]) + ty * (r - self.y[v]))
                value[r, c] = height[r, c] + slope[r, c] @ (self.place[r, c] - [c, r])
            if round_number and np.nanmax(np.abs(height - before)) < 1e-11:
                break
        return height


def test_the_order_of_the_returns_changes_nothing():
    rng = np.random.default_rng(14)
    returns, _ = returns_on(rolling, 20_000, rng, noise=0.01, sigma=0.01, outliers=0.01)
    one = grid_returns("A", GRID, returns)
    order = rng.permutation(len(returns))
    other = grid_returns("A", GRID, returns.select(order))
    assert one.report == other.report
    for layer in ("height", "sigma", "spread", "count"):
        a, b = getattr(one.mapola, layer), getattr(other.mapola, layer)
        assert np.array_equal(a, b, equal_nan=True), layer
    assert np.array_equal(one.used[order], other.used)


@pytest.mark.parametrize("per_cell", [1.5, 3.0, 8.0])
def test_outliers_are_rejected_and_little_else(per_cell):
    rng = np.random.default_rng(15)
    count = int(per_cell * 61**2)
    returns, outlier = returns_on(rolling, count, rng, noise=0.01, sigma=0.01, outliers=0.005)
    result = grid_returns("A", GRID, returns)
    x, y, height = GRID.project(returns.points)
    gross = outlier & (np.abs(height - rolling(x * GRID.gsd, y * GRID.gsd)) > 4 * GRID.gsd)
    assert gross.sum() > 10
    assert not (result.used & gross).any()
    lost = ~result.used & ~outlier
    assert lost.mean() < 1e-3
    report = result.report
    assert report.used == result.used.sum()
    assert report.offered == report.used + report.ignored + report.isolated + report.outlying
    filled = np.zeros(GRID.shape, dtype=bool)
    inside = np.abs(np.floor([y + 0.5, x + 0.5])).max(axis=0) <= GRID.half_size
    cell = np.floor([y[inside] + 30.5, x[inside] + 30.5]).astype(int)
    filled[cell[0], cell[1]] = True
    assert report.emptied == filled.sum() - result.mapola.valid.sum()


def test_outliers_beyond_the_edge_of_a_raster_are_rejected():
    rng = np.random.default_rng(18)
    dense, _ = returns_on(rolling, 12 * 61**2, rng, noise=0.01, sigma=0.01)
    x = GRID.project(dense.points)[0]
    lone = rng.uniform([2.0, -30.0, -2.0], [30.0, 30.0, 2.0], (40, 3))
    outliers = lifted(GRID, lone[:, 0], lone[:, 1], lone[:, 2])
    points = np.concatenate([dense.points[x < 0.0], outliers])
    count = len(points)
    half = Returns(points, np.full(count, 0.01), np.zeros(count, dtype=np.int32), ("a",))
    result = grid_returns("A", GRID, half)
    assert not result.used[-40:].any()
    assert result.used[:-40].mean() > 0.999
    assert np.isnan(result.mapola.height[:, 33:]).all()


def test_outliers_side_by_side_beyond_the_edge_do_not_support_each_other():
    rng = np.random.default_rng(31)
    raster, _ = returns_on(plane, 12 * 61**2, rng, noise=0.003)
    x, _, _ = GRID.project(raster.points)
    # A rim of single returns, two cells wide, is ground; two outliers beyond it are not.
    rim_x, rim_y = np.repeat([10.9, 11.9], 40), np.tile(np.arange(-20.0, 20.0), 2)
    rim = lifted(GRID, rim_x, rim_y, plane(rim_x * GRID.gsd, rim_y * GRID.gsd))
    outliers = lifted(GRID, np.array([17.0, 18.0]), np.zeros(2), np.array([-2.0, -1.98]))
    points = np.concatenate([raster.points[x < 10.5], rim, outliers])
    returns = Returns(
        points, np.full(len(points), np.nan), np.zeros(len(points), dtype=np.int32), ("a",)
    )
    gridding = grid_returns("A", GRID, returns)
    assert not gridding.used[-2:].any()
    assert gridding.used[-2 - len(rim) : -2].all()


def test_an_isolated_return_next_to_a_track_does_not_tilt_it():
    """In a grid that is dense elsewhere: the track alone does not determine a slope across."""
    rng = np.random.default_rng(32)
    raster, _ = returns_on(plane, 20 * 61**2, rng, noise=0.01)
    x, _, _ = GRID.project(raster.points)
    along = np.linspace(-25.0, 25.0, 500)
    across = 18.0 + 0.19 * along
    track = lifted(GRID, across, along, plane(across * GRID.gsd, along * GRID.gsd))
    track += 0.01 * rng.normal(size=(len(track), 1)) * GRID.uz
    # Where the track changes its column, its only two steps across are at the isolated return.
    outlier = lifted(GRID, np.array([17.2]), np.array([3.0]), np.array([-1.2]))
    points = np.concatenate([raster.points[x < 0.0], track, outlier])
    returns = Returns(
        points, np.full(len(points), 0.01), np.zeros(len(points), dtype=np.int32), ("a",)
    )
    gridding = grid_returns("A", GRID, returns)
    assert not gridding.used[-1]
    error = (gridding.mapola.height - plane(X, Y))[:, 41:]
    # Without a slope across it, a height may miss by half a cell of the plane's tilt.
    assert np.nanmax(np.abs(error)) < 0.05


def test_shots_far_apart_are_not_rejected():
    rng = np.random.default_rng(19)
    returns, _ = returns_on(rolling, 120, rng, noise=0.01, sigma=0.01)
    result = grid_returns("A", GRID, returns)
    assert result.report.isolated == 0
    assert result.mapola.valid.sum() > 110


def test_boulders_stay():
    """Three cells across and three high: steep, but neighbours agree.

    The plane through the step costs the rim up to half a cell of its slope.
    """

    def ground(x, y):
        return np.where(np.maximum(np.abs(x - 0.5), np.abs(y + 0.8)) < 0.15, 0.3, 0.0)

    rng = np.random.default_rng(16)
    returns, _ = returns_on(ground, 2 * 61**2, rng, noise=0.003, sigma=0.003)
    result = grid_returns("A", GRID, returns)
    assert result.report.isolated == 0
    assert np.nanmin(result.mapola.height[21:24, 34:37]) > 0.2


def test_a_second_sheet_far_from_the_surface_is_left_out():
    rng = np.random.default_rng(17)
    returns, _ = returns_on(plane, 8 * 61**2, rng, noise=0.005, sigma=0.005)
    over = rng.random(len(returns)) < 0.3
    points = returns.points + np.where(over, 1.5, 0.0)[:, None] * GRID.uz
    doubled = Returns(points, returns.sigma, returns.scan, returns.scan_names)
    result = grid_returns("A", GRID, doubled)
    dense = result.mapola.count >= 5
    assert not (result.used & over).sum() > 0.01 * over.sum()
    assert np.median(np.abs(result.mapola.height - plane(X, Y))[dense]) < 0.005


def test_the_far_side_and_the_surroundings_are_ignored():
    rng = np.random.default_rng(18)
    near, _ = returns_on(rolling, 5000, rng, noise=0.01, sigma=0.01)
    far = near.points - 100.0 * GRID.uz
    off_side = near.points + 7.0 * GRID.ux
    points = np.concatenate([near.points, far, off_side])
    both = Returns(points, np.tile(near.sigma, 3), np.tile(near.scan, 3), near.scan_names)
    result = grid_returns("A", GRID, both)
    assert np.array_equal(result.mapola.height, make_mapola("A", GRID, near).height, equal_nan=True)
    assert result.report.ignored == 10_000


def test_gaps_stay_unknown_and_empty_grids_too():
    rng = np.random.default_rng(19)
    returns, _ = returns_on(plane, 20_000, rng, noise=0.01, sigma=0.01)
    x, y, _ = GRID.project(returns.points)
    mapola = make_mapola("A", GRID, returns.select(np.hypot(x - 5, y) > 8.0))
    hole = np.hypot(X / GRID.gsd - 5, Y / GRID.gsd) < 7.2
    for layer in (mapola.height, mapola.sigma, mapola.spread):
        assert np.isnan(layer[hole]).all()
    assert (mapola.count[hole] == 0).all()
    assert mapola.valid[~hole].mean() > 0.9
    empty = grid_returns("A", GRID, returns.select(slice(0, 0)))
    assert isinstance(empty.mapola, Mapola)
    assert not empty.mapola.valid.any()
    assert empty.report.converged
    assert empty.mapola.scan_share == {}


@pytest.mark.parametrize(
    ("per_cell", "known", "tolerance"),
    [
        (1.0, True, 0.02),
        (3.0, True, 0.02),
        (10.0, True, 0.02),
        (40.0, True, 0.02),
        # With hardly a cell of three returns the spread is poorly known, and taken too large.
        (1.0, False, 0.09),
        (3.0, False, 0.02),
        (10.0, False, 0.02),
        (40.0, False, 0.02),
    ],
)
def test_sigma_is_that_of_the_errors(per_cell, known, tolerance):
    """Error over sigma has standard deviation 1; the sample alone allows 1 %."""
    rng = np.random.default_rng(20)
    noise, ratios = 0.02, []
    for _ in range(3):
        returns, _ = returns_on(
            plane, int(per_cell * 61**2), rng, noise=noise, sigma=noise if known else np.nan
        )
        mapola = make_mapola("A", GRID, returns)
        ratios.append(((mapola.height - plane(X, Y)) / mapola.sigma)[mapola.valid])
    assert np.std(np.concatenate(ratios)) == pytest.approx(1.0, abs=tolerance)


def test_sigma_grows_with_the_roughness_inside_the_cells():
    rng = np.random.default_rng(21)
    returns, _ = returns_on(plane, 20 * 61**2, rng, noise=0.05, sigma=0.01)
    mapola = make_mapola("A", GRID, returns)
    ratio = (mapola.height - plane(X, Y)) / mapola.sigma
    assert np.std(ratio) == pytest.approx(1.0, abs=0.04)
    assert np.nanmedian(mapola.spread) == pytest.approx(0.05, rel=0.1)


def test_without_any_spread_the_default_sigma_is_taken():
    points = GRID.points(plane(X, Y)).reshape(-1, 3)
    unknown = Returns(points, np.full(len(points), np.nan), np.zeros(len(points), int), ("a",))
    options = GriddingOptions(default_sigma_m=0.33)
    assert np.allclose(make_mapola("A", GRID, unknown, options=options).sigma, 0.33, rtol=1e-9)


def test_median_sigma_is_that_of_sampled_medians():
    assert median_sigma(np.array([1, 2])) == pytest.approx([1.0, np.sqrt(0.5)], rel=1e-15)
    rng = np.random.default_rng(22)
    for count in (3, 4, 5, 6, 9, 10, 25):
        sampled = np.std(np.median(rng.normal(size=(200_000, count)), axis=1))
        assert median_sigma(np.array(count)) == pytest.approx(sampled, rel=0.018)
    assert median_sigma(np.array(10**6)) == pytest.approx(np.sqrt(np.pi / 2e6), rel=1e-5)
    assert np.isnan(median_sigma(np.array(0)))


def test_scan_shares_are_those_of_the_used_returns():
    rng = np.random.default_rng(23)
    returns, _ = returns_on(plane, 4000, rng, noise=0.01, sigma=0.01)
    scan = np.repeat([0, 2], [1000, 3000])
    mixed = Returns(returns.points, returns.sigma, scan, ("a", "unused", "b"))
    result = grid_returns("A", GRID, mixed)
    share = result.mapola.scan_share
    assert set(share) == {"a", "b"}
    assert share["a"] == np.mean(scan[result.used] == 0)
    assert sum(share.values()) == pytest.approx(1.0, abs=1e-15)


def test_returns_are_collected_from_scans():
    rng = np.random.default_rng(24)
    chunks = [
        Scan.of_points(name, rng.normal(size=(n, 3)), sigma=np.full(n, 0.1))
        for name, n in (("a", 3), ("b", 4), ("a", 2))
    ]
    returns = Returns.of_scans(chunks)
    assert returns.scan_names == ("a", "b")
    assert list(returns.scan) == [0, 0, 0, 1, 1, 1, 1, 0, 0]
    assert np.array_equal(returns.points[3:7], chunks[1].points)
    with pytest.raises(InvalidValueError, match="different body-fixed frames"):
        Returns.of_scans([chunks[0], Scan.of_points("c", np.zeros((1, 3)), body="moon")])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"points": np.zeros((3, 2))}, "points: has shape"),
        ({"points": np.full((3, 3), np.nan)}, "points: holds a value that is not finite"),
        ({"sigma": np.zeros(3)}, "sigma: must be positive"),
        ({"sigma": np.ones(2)}, "sigma: has shape"),
        ({"scan": np.zeros(3)}, "scan: is float64, integers are needed"),
        ({"scan": np.array([0, 0, 1])}, "scan: names a scan that is not in scan_names"),
    ],
)
def test_returns_that_break_their_rules_are_refused(change, message):
    good = {
        "points": np.zeros((3, 3)),
        "sigma": np.ones(3),
        "scan": np.zeros(3, dtype=int),
        "scan_names": ("a",),
    }
    Returns(**good)
    with pytest.raises(InvalidValueError, match=message):
        Returns(**{**good, **change})


@pytest.mark.parametrize("name", ["tolerance", "max_iterations", "baseline", "reach_m"])
def test_options_out_of_range_are_refused(name):
    with pytest.raises(SettingsError, match=name):
        GriddingOptions(**{name: -1.0})
    with pytest.raises(SettingsError, match=r"rejection\.few"):
        RejectionOptions(few=0)
