"""What bridges gaps where SPC filled in without slopes from images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from fusion.fusing.constraints import Constraints
from fusion.fusing.fuse import FuseInput, fuse_maplet
from fusion.fusing.information import DEFAULT_INFORMATION
from fusion.fusing.prior import bridging_surface
from spcola.maplet import Maplet, MapletGrid
from spcola.photoclinometry import SlopeVariance

GRID = MapletGrid.facing([80.0, 10.0, 5.0], [1.0, 0.1, 0.1], 0.5, 20)
SIZE = GRID.size


def hills(seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(size=GRID.shape)
    smooth = ndimage.gaussian_filter(noise, 4.0)
    return 0.5 * smooth / smooth.std()


def half_lit() -> SlopeVariance:
    """Images tell the slopes of the left half."""
    lit = np.zeros(GRID.shape)
    lit[:, SIZE // 2 :] = np.inf
    variance = 0.01 + lit
    return SlopeVariance(variance, variance, np.where(np.isfinite(variance), 5, 0))


def test_spc_goes_before_the_shape_and_no_step_stands_between() -> None:
    ground = hills(1)
    spc = Maplet("A", GRID, np.where(np.arange(SIZE) < 30, ground, np.nan))
    shape = ground - 0.75
    surface = bridging_surface(shape, spc, half_lit())
    np.testing.assert_array_equal(surface[spc.valid], ground[spc.valid])
    np.testing.assert_allclose(surface, ground, atol=1e-12)
    np.testing.assert_array_equal(bridging_surface(shape, spc, None), shape)
    unknown = np.full(GRID.shape, np.nan)
    np.testing.assert_array_equal(bridging_surface(unknown, spc, half_lit()), spc.height)


@pytest.mark.parametrize("seed", range(4))
def test_gaps_at_the_border_of_light_are_bridged_by_one_surface(seed: int) -> None:
    """A shape that lies 0.75 m below SPC must not show where a return is missing."""
    ground = hills(seed)
    spc, light = Maplet("A", GRID, ground + 0.05), half_lit()
    assert light.defined[:, : SIZE // 2].all()
    assert not light.defined[:, SIZE // 2 :].any()
    rng = np.random.default_rng(seed)
    lidar = ground + rng.normal(0.0, 0.02, GRID.shape)
    gaps = rng.random(GRID.shape) < 0.1
    lidar[gaps] = np.nan
    known = ~gaps
    parts = FuseInput(
        name="A",
        grid=GRID,
        spc=replace(spc, height=np.where(light.defined, spc.height, np.nan)),
        lidar=Constraints(
            lidar, np.where(known, 0.02, np.nan), np.where(known, 3, 0).astype(np.int32)
        ),
        prior=bridging_surface(ground - 0.75, spc, light),
        common_covariance=np.zeros((3, 3)),
        light=light,
    )
    fused = fuse_maplet(parts, DEFAULT_INFORMATION).maplet
    off = np.abs(fused.height - ground)[gaps]
    assert off.max() < 0.1
    assert np.mean(off < 3.0 * fused.sigma[gaps]) > 0.95
