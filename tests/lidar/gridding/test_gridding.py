"""Mapolas from returns: planted surfaces recovered, order, outliers, calibrated sigma."""

from __future__ import annotations

import numpy as np
import pytest
from made_returns import GRID, KEEP_ALL, X, Y, lifted, plane, returns_on, rolling

from lidar.gridding import GriddingOptions, Mapola, grid_returns, make_mapola
from lidar.gridding.rejection import RejectionOptions
from lidar.gridding.sigma import median_sigma
from lidar.scans import Returns, Scan
from spcola.errors import InvalidValueError, SettingsError
from spcola.grids import MapletGrid


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
