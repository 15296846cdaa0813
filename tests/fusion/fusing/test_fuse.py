"""Fused maplets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fused_scene import GRID, SIZE, information_of, rms, scene, truth

from fusion.fusing import (
    Constraints,
    FuseInput,
    FuseOptions,
    fuse_maplet,
)
from fusion.fusing.maplets import Source
from fusion.fusing.uncertainty import (
    DEFAULT_INFORMATION,
    AlignedHeights,
    SlopeInformation,
    estimate_information,
)
from spcola.grids import Maplet


@pytest.mark.parametrize(("cover", "gain"), [(1.0, 0.95), (0.3, 1.0)])
def test_fused_heights_are_better_than_either_source(cover, gain):
    # With gaps the fused heights of all points stand against lidar heights of a third of them.
    gains = []
    for seed in range(5):
        surface, parts = scene(seed, lidar_sigma=0.06, cover=cover)
        fused = fuse_maplet(parts, information_of(parts)).maplet
        lidar_only = rms(parts.lidar.height - surface)
        spc_only = rms(parts.spc.height - surface)
        gains.append(rms(fused.height - surface) / min(lidar_only, spc_only))
    assert np.mean(gains) < gain


def test_sigma_is_the_size_of_the_errors():
    inside = {1: [], 2: []}
    for seed in range(6):
        surface, parts = scene(100 + seed, cover=0.5)
        fused = fuse_maplet(parts, information_of(parts)).maplet
        pull = np.abs(fused.height - surface) / fused.sigma
        for times, shares in inside.items():
            shares.append(np.mean(pull < times))
    assert 0.60 < np.mean(inside[1]) < 0.85
    assert 0.90 < np.mean(inside[2]) <= 1.0


@pytest.mark.parametrize("covered", [0, 12])
def test_ground_far_from_lidar_has_the_sigma_of_spc(covered):
    """SPC errors: 10 cm, correlated over some cells, and 6 cm as a whole; neither averages out."""
    inside, sigmas = {1: [], 2: []}, []
    for seed in range(24):
        surface, parts = scene(300 + seed)
        offset = 0.06 * np.random.default_rng(seed).normal()
        stated = {"sigma": np.full(GRID.shape, 0.1), "center_sigma": np.full(3, 0.06)}
        spc = Maplet("AA0001", GRID, parts.spc.height + offset, **stated)
        known = np.arange(SIZE) < covered
        lidar = Constraints(
            np.where(known, parts.lidar.height, np.nan),
            np.where(known, parts.lidar.sigma, np.nan),
            np.where(known, parts.lidar.count, 0),
        )
        part = FuseInput("AA0001", GRID, spc, lidar, parts.prior, parts.common_covariance)
        fused = fuse_maplet(part, information_of(parts)).maplet
        far = np.s_[:, covered + 15 :]
        pull = np.abs(fused.height - surface)[far] / fused.sigma[far]
        sigmas.append(np.median(fused.sigma[far]))
        for times, shares in inside.items():
            shares.append(np.mean(pull < times))
        if covered:
            assert np.median(fused.sigma[:, covered + 1]) < 0.9 * sigmas[-1]
    assert np.mean(sigmas) > 0.1
    assert 0.58 < np.mean(inside[1]) < 0.8
    assert 0.9 < np.mean(inside[2]) < 0.99


def test_shadow_is_filled_from_the_lidar_without_a_step_at_its_border():
    dark = np.zeros((SIZE, SIZE), dtype=bool)
    dark[:, :25] = True
    steps = {"border": [], "inside": []}
    for seed in range(6):
        surface, parts = scene(200 + seed, dark=dark)
        fused = fuse_maplet(parts, information_of(parts)).maplet
        assert np.all(fused.source[:, :25] == Source.LIDAR)
        assert np.all(fused.source[:, 25:] == Source.BOTH)
        error = np.diff(fused.height - surface, axis=1)
        steps["border"].append(rms(error[:, 24]))
        steps["inside"].append(rms(error[:, :24]))
        assert rms((fused.height - surface)[:, :25]) < 1.05 * rms(
            (parts.lidar.height - surface)[:, :25]
        )
    assert np.mean(steps["border"]) < 1.15 * np.mean(steps["inside"])


def test_gaps_of_both_are_filled_from_the_shape_and_marked():
    hole = np.zeros((SIZE, SIZE), dtype=bool)
    hole[20:35, 20:35] = True
    surface, parts = scene(7, dark=hole)
    height = np.where(hole, np.nan, parts.lidar.height)
    lidar = Constraints(
        height, np.where(hole, np.nan, parts.lidar.sigma), np.where(hole, 0, parts.lidar.count)
    )
    bare = FuseInput(parts.name, GRID, parts.spc, lidar, parts.prior, parts.common_covariance)
    fused = fuse_maplet(bare, information_of(bare)).maplet
    assert np.all(fused.source[hole] == Source.FILLED)
    assert np.all(fused.count[hole] == 0)
    assert np.nanmedian(fused.sigma[25:30, 25:30]) > 3 * np.nanmedian(fused.sigma[~hole])
    assert np.mean(np.abs(fused.height - surface)[hole] < 2 * fused.sigma[hole]) > 0.9
    nothing = FuseInput(
        parts.name, GRID, parts.spc, lidar, np.full(GRID.shape, np.nan), parts.common_covariance
    )
    unknown = fuse_maplet(nothing, information_of(bare)).maplet
    assert np.isnan(unknown.height[hole]).all()
    assert np.all(unknown.source[hole] == Source.NONE)


def test_without_lidar_the_maplet_is_kept_and_the_part_named():
    _, parts = scene(8)
    none = np.full(GRID.shape, np.nan)
    dry = FuseInput(
        parts.name,
        GRID,
        parts.spc,
        Constraints(none, none, np.zeros(GRID.shape, dtype=np.int32)),
        parts.prior,
        parts.common_covariance,
    )
    result = fuse_maplet(dry, DEFAULT_INFORMATION)
    assert result.parts_without_lidar == 1
    np.testing.assert_allclose(result.maplet.height, parts.spc.height, atol=1e-3)
    assert np.all(result.maplet.source == Source.IMAGE)


def test_outliers_are_down_weighted_by_the_loss():
    surface, parts = scene(9)
    height = parts.lidar.height.copy()
    height[10:50:8, 12:50:8] += 3.0
    spiked = FuseInput(
        parts.name,
        GRID,
        parts.spc,
        Constraints(height, parts.lidar.sigma, parts.lidar.count),
        parts.prior,
        parts.common_covariance,
    )
    robust = fuse_maplet(spiked, information_of(parts), options=FuseOptions(loss="cauchy"))
    plain = fuse_maplet(spiked, information_of(parts), options=FuseOptions(loss="l2"))
    assert robust.downweighted >= 25
    assert rms(robust.maplet.height - surface) < 0.5 * rms(plain.maplet.height - surface)


def test_a_subset_is_reproducible_and_its_own_for_each_maplet():
    _, parts = scene(10)
    options = FuseOptions(fraction=0.1, seed=3)
    one = fuse_maplet(parts, DEFAULT_INFORMATION, options=options).maplet
    two = fuse_maplet(parts, DEFAULT_INFORMATION, options=options).maplet
    np.testing.assert_array_equal(one.height, two.height)
    assert 0.05 < one.share(Source.BOTH) < 0.15
    other = FuseInput("BB0002", GRID, parts.spc, parts.lidar, parts.prior, parts.common_covariance)
    moved = fuse_maplet(other, DEFAULT_INFORMATION, options=options).maplet
    assert not np.array_equal(one.source, moved.source)


def test_what_all_heights_share_enters_the_sigma_also_through_the_slope():
    _, parts = scene(11)
    _, shared = scene(11, common=0.1)
    alone = fuse_maplet(parts, DEFAULT_INFORMATION).maplet
    both = fuse_maplet(shared, DEFAULT_INFORMATION).maplet
    added = np.sqrt(both.sigma**2 - alone.sigma**2)
    assert added.min() == pytest.approx(0.1, rel=0.02)
    slope = np.hypot(*np.gradient(both.height, GRID.gsd))
    np.testing.assert_allclose(added, 0.1 * np.hypot(1.0, slope), rtol=0.02, atol=2e-3)


def test_information_recovers_a_planted_random_walk():
    generator = np.random.default_rng(12)
    pairs = []
    for _ in range(8):
        surface = truth(generator)
        # Independent steps along x: an error whose variogram is linear, lag by lag.
        walk = np.cumsum(0.02 * generator.normal(size=(SIZE, SIZE)), axis=1)
        lidar = surface + 0.03 * generator.normal(size=surface.shape)
        pairs.append(AlignedHeights(lidar, surface + walk, np.full(GRID.shape, 0.03), GRID.gsd))
    found = estimate_information(pairs)
    # Along y neighbours are independent walks, so that the estimate lies above 0.02.
    assert 0.02 < found.step_sigma_m < 0.2


def test_information_takes_the_lidar_noise_off():
    generator = np.random.default_rng(13)
    surface = truth(generator)
    pair = AlignedHeights(
        surface + 0.05 * generator.normal(size=GRID.shape),
        surface,
        np.full(GRID.shape, 0.05),
        GRID.gsd,
    )
    found = estimate_information([pair])
    assert found.step_sigma_m < 0.02
    assert found.height_sigma_m < 0.02
    assert estimate_information([]) == DEFAULT_INFORMATION


def test_steps_on_steep_and_on_bent_ground_are_less_certain():
    information = SlopeInformation(0.03, 0.4, 0.3, 0.1, 20.0)
    flat = np.array(0.0)
    assert information.step_sigma(flat, flat, 0.5) == pytest.approx(0.03)
    assert information.step_sigma(np.array(-1.0), flat, 0.5) == pytest.approx(np.hypot(0.03, 0.2))
    assert information.step_sigma(flat, np.array(0.2), 0.5) == pytest.approx(np.hypot(0.03, 0.06))


def with_lidar(parts, height, count):
    """`parts` with other lidar heights, of `count` returns each, and their sigma as before."""
    known = np.isfinite(height)
    sigma = np.where(known, 0.03, np.nan)
    return replace(parts, lidar=Constraints(height, sigma, np.where(known, count, 0)))


@pytest.mark.parametrize("error", [20.0, -3.0])
def test_a_lone_lidar_height_in_a_gap_cannot_pull_the_surface_from_spc(error):
    """It would lower the weights of the steps around it, so that no loss could act."""
    ratios, pulled = [], []
    for seed in range(4):
        surface, parts = scene(400 + seed)
        row, column = np.mgrid[:SIZE, :SIZE]
        height = np.where(np.hypot(row - 30, column - 30) < 14, np.nan, parts.lidar.height)
        places = np.s_[[30, 26, 34, 38, 25], [30, 35, 24, 33, 26]]
        without = fuse_maplet(with_lidar(parts, height, 1), information_of(parts)).maplet
        height[places] = surface[places] + error
        result = fuse_maplet(with_lidar(parts, height, 1), information_of(parts))
        fused = result.maplet
        assert result.contradicted == 5
        assert (fused.source[places] == Source.IMAGE).all()
        np.testing.assert_array_equal(fused.height, without.height)
        # It may be a boulder that SPC lacks.
        assert (fused.sigma[places] > 0.9 * min(abs(error), GRID.gsd)).all()
        pulled.append(np.abs(fused.height - surface).max())
        gap = np.hypot(row - 30, column - 30) < 14
        ratios.append((np.abs(fused.height - surface) / fused.sigma)[gap])
    assert max(pulled) < 1.0
    assert 0.60 < np.mean(np.concatenate(ratios) < 1) < 0.85
    assert 0.90 < np.mean(np.concatenate(ratios) < 2) <= 1.0


def test_two_false_echoes_side_by_side_are_no_boulder_and_four_cells_square_are():
    surface, parts = scene(11)
    height = parts.lidar.height.copy()
    height[20:40, 20:40] = np.nan
    height[30, 30:32] = surface[30, 30:32] - np.array([18.0, 17.0])
    height[44:48, 44:48] = surface[44:48, 44:48] + 2.0
    result = fuse_maplet(with_lidar(parts, height, 1), information_of(parts))
    assert result.contradicted == 2
    fused = result.maplet
    assert (fused.source[44:48, 44:48] == Source.BOTH).all()
    assert np.abs((fused.height - surface)[44:48, 44:48] - 2.0).max() < 0.2
    assert np.abs((fused.height - surface)[30, 30:32]).max() < 0.6


def test_a_maplet_out_of_place_contradicts_no_lone_shot():
    surface, parts = scene(12)
    shots = np.where(np.random.default_rng(1).random(GRID.shape) < 0.01, surface, np.nan)
    moved = Maplet("AA0001", GRID, parts.spc.height + 4.0, center_sigma=np.full(3, 4.0))
    result = fuse_maplet(with_lidar(replace(parts, spc=moved), shots, 1), DEFAULT_INFORMATION)
    assert result.contradicted == 0
    known = np.isfinite(shots)
    assert rms((result.maplet.height - surface)[known]) < 0.1


def test_two_common_points_do_not_show_which_is_wrong():
    surface, parts = scene(13)
    shots = np.full(GRID.shape, np.nan)
    shots[20, 20], shots[40, 40] = surface[20, 20], surface[40, 40] + 5.0
    result = fuse_maplet(with_lidar(parts, shots, 1), DEFAULT_INFORMATION)
    assert result.contradicted == 0
