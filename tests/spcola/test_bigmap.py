"""Bigmaps from maplets cut out of one analytic surface."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spcola.bigmap import Bigmap, BigmapOptions, make_bigmap
from spcola.errors import InvalidValueError, SettingsError
from spcola.grids import Maplet, MapletGrid

GRID = MapletGrid([0.0, 0.0, 100.0], np.eye(3), 1.0, 30)


def surface(x, y):
    return 100.0 + 0.8 * np.sin(x / 9.0) * np.cos(y / 7.0) + 0.05 * x


def cut(name, x, y, *, tilt_deg=0.0, gsd=1.0, half_size=15, offset=0.0, sigma=None):
    """A maplet of the surface around (x, y), turned by `tilt_deg`, raised by `offset` (m)."""
    axes = Rotation.from_euler("xyz", [tilt_deg, -tilt_deg, 5 * tilt_deg], degrees=True).as_matrix()
    grid = MapletGrid([x, y, surface(x, y)], axes.T, gsd, half_size)
    height = np.zeros(grid.shape)
    for _ in range(60):
        points = grid.points(height)
        height -= (points[..., 2] - surface(points[..., 0], points[..., 1])) / grid.uz[2] * 0.9
    return Maplet(name, grid, height + offset, sigma=sigma)


def many(offsets=None, **how):
    """Maplets that overlap by half over the whole bigmap and beyond."""
    rng = np.random.default_rng(0)
    offsets = {} if offsets is None else offsets
    places = [(x, y) for y in range(-36, 37, 12) for x in range(-36, 37, 12)]
    return [
        cut(f"M{k}", x, y, tilt_deg=rng.uniform(-6, 6), offset=offsets.get(k, 0.0), **how)
        for k, (x, y) in enumerate(places)
    ]


def truth():
    x, y = np.meshgrid(GRID.offsets, GRID.offsets)
    return surface(x, y) - 100.0


@pytest.mark.parametrize(
    "options",
    [BigmapOptions(), BigmapOptions(constraint_fraction=1.0), BigmapOptions(integrate=False)],
)
def test_maplets_of_one_surface_give_it_back(options):
    bigmap = make_bigmap("BIG", GRID, many(), options=options)
    assert isinstance(bigmap, Bigmap)
    assert bigmap.valid.all()
    assert (bigmap.count >= 4).all()
    # Bilinear cells of 1 m miss curvatures up to 0.03/m by at most 8 mm.
    assert np.abs(bigmap.height - truth()).max() < 0.012
    assert np.sqrt(np.mean((bigmap.height - truth()) ** 2)) < 0.004
    assert np.nanmax(bigmap.sigma) < 0.01
    assert (bigmap.sigma > 0).all()
    np.testing.assert_allclose(bigmap.albedo, 1.0)


def edge_steps(bigmap, maplet):
    """Height steps (minus those of the truth) across the border of a maplet, and elsewhere."""
    error = bigmap.height - truth()
    points = GRID.points(truth()).reshape(-1, 3)
    u, v, _ = (each.reshape(GRID.shape) for each in maplet.grid.project(points))
    q = maplet.grid.half_size
    inside = (np.abs(u) <= q) & (np.abs(v) <= q)
    step = np.diff(error, axis=1)
    across = inside[:, 1:] != inside[:, :-1]
    return np.sqrt(np.mean(step[across] ** 2)), np.sqrt(np.mean(step[~across] ** 2))


@pytest.mark.parametrize("fraction", [0.02, 1.0])
def test_raised_maplets_leave_no_steps(fraction):
    raised = {24: 1.5, 10: -1.0}
    maplets = many(raised)
    averaged = make_bigmap("A", GRID, maplets, options=BigmapOptions(integrate=False))
    across, elsewhere = edge_steps(averaged, maplets[24])
    assert across > 0.15
    assert across > 4 * elsewhere
    smooth = make_bigmap("B", GRID, maplets, options=BigmapOptions(constraint_fraction=fraction))
    across, elsewhere = edge_steps(smooth, maplets[24])
    assert across < 0.02
    assert across < 2 * elsewhere
    # Where heights contradict one another, sigma shows it.
    assert averaged.sigma[30, 30] > 0.3
    assert np.median(averaged.sigma[:8, :8]) < 0.01


def test_same_seed_same_bigmap():
    maplets = many({24: 1.0})
    one, two, other = (
        make_bigmap("B", GRID, maplets, options=BigmapOptions(seed=seed)) for seed in (3, 3, 4)
    )
    np.testing.assert_array_equal(one.height, two.height)
    assert np.abs(one.height - other.height).max() > 1e-3


def test_average_is_weighted_by_the_square_of_the_gsd():
    low = Maplet("L", MapletGrid(GRID.center, np.eye(3), 1.0, 40), np.zeros((81, 81)))
    high = Maplet("H", MapletGrid(GRID.center, np.eye(3), 2.0, 20), np.full((41, 41), 3.0))
    bigmap = make_bigmap("B", GRID, [low, high], options=BigmapOptions(integrate=False))
    a, b = 1 / 2, 1 / 5
    mean = 3.0 * b / (a + b)
    np.testing.assert_allclose(bigmap.height, mean)
    spread = (a * mean**2 + b * (3 - mean) ** 2) / (a + b - (a * a + b * b) / (a + b))
    np.testing.assert_allclose(bigmap.sigma, np.sqrt(spread))
    assert (bigmap.count == 2).all()


def test_maplets_that_agree_by_chance_keep_the_sigma_that_they_state():
    stated = [np.full((31, 31), sigma) for sigma in (0.03, 0.05)]
    maplets = [cut("A", 0.0, 0.0, sigma=stated[0]), cut("B", 0.0, 0.0, sigma=stated[1])]
    agreed = make_bigmap("BIG", maplets[0].grid, maplets)
    rms = np.sqrt((0.03**2 + 0.05**2) / 2)
    np.testing.assert_allclose(agreed.sigma[agreed.valid], rms)
    apart = [maplets[0], cut("B", 0.0, 0.0, sigma=stated[1], offset=1.0)]
    far = make_bigmap("BIG", maplets[0].grid, apart)
    np.testing.assert_allclose(far.sigma[far.valid], np.sqrt(0.5), rtol=1e-3)


def test_single_maplet_lends_its_own_sigma_or_none():
    plain = make_bigmap("B", GRID, [cut("A", 0.0, 0.0)])
    assert plain.valid.any()
    assert not plain.valid.all()
    assert np.isnan(plain.sigma).all()
    known = cut("A", 0.0, 0.0, sigma=np.full((31, 31), 0.07))
    bigmap = make_bigmap("B", GRID, [known])
    np.testing.assert_allclose(bigmap.sigma[bigmap.valid], 0.07)
    assert np.array_equal(bigmap.count > 0, bigmap.valid)
    np.testing.assert_allclose(bigmap.height[30, 30], truth()[30, 30], atol=0.01)


def test_limits_on_gsd_and_distance():
    fine, coarse = cut("F", 0.0, 0.0), cut("C", 0.0, 0.0, gsd=3.0, half_size=12)
    options = BigmapOptions(max_gsd=2.0)
    assert (make_bigmap("B", GRID, [fine, coarse], options=options).count <= 1).all()
    outlier = cut("S", 0.0, 0.0, offset=25.0)
    near = make_bigmap("B", GRID, [fine, outlier], options=BigmapOptions(max_distance=10.0))
    np.testing.assert_array_equal(near.height, make_bigmap("B", GRID, [fine]).height)
    above = make_bigmap(
        "B",
        GRID,
        [fine, outlier],
        options=BigmapOptions(max_distance=10.0),
        reference=np.full(GRID.shape, 25.0),
    )
    assert above.height[30, 30] == pytest.approx(25.0, abs=1.0)


def test_nothing_in_reach_is_an_empty_bigmap():
    far = cut("A", 300.0, 0.0)
    bigmap = make_bigmap("B", GRID, [far])
    assert not bigmap.valid.any()
    assert not bigmap.count.any()
    assert np.isnan(bigmap.sigma).all()


def test_parts_without_constraint_keep_their_mean_height():
    """Two maplets far apart, and so few constraints that one of them gets none."""
    left, right = (cut(n, x, 0.0, half_size=5) for n, x in (("L", -20.0), ("R", 20.0)))
    options = BigmapOptions(constraint_fraction=1e-4)
    bigmap = make_bigmap("B", GRID, [left, right], options=options)
    np.testing.assert_allclose(bigmap.height, np.where(bigmap.valid, truth(), np.nan), atol=0.02)


def test_bad_values_are_refused():
    with pytest.raises(SettingsError, match="constraint_fraction"):
        BigmapOptions(constraint_fraction=0.0)
    with pytest.raises(SettingsError, match="max_gsd"):
        BigmapOptions(max_gsd=-1.0)
    with pytest.raises(InvalidValueError, match="reference"):
        make_bigmap("B", GRID, [], reference=np.zeros((3, 3)))
    with pytest.raises(InvalidValueError, match="no maplet reaches"):
        Bigmap("B", GRID, np.zeros(GRID.shape), count=np.zeros(GRID.shape))
