"""A made-up maplet, lidar heights and a shape on one grid."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from fusion.fusing import (
    Constraints,
    FuseInput,
)
from fusion.fusing.uncertainty import (
    AlignedHeights,
    estimate_information,
)
from spcola.grids import Maplet, MapletGrid

GRID = MapletGrid.facing([80.0, 10.0, 5.0], [1.0, 0.1, 0.1], 0.5, 30)


SIZE = GRID.size


def correlated(generator, sigma, cells):
    field = ndimage.gaussian_filter(generator.normal(size=(SIZE + 40, SIZE + 40)), cells)
    field = field[20:-20, 20:-20]
    return sigma * field / field.std()


def truth(generator):
    return correlated(generator, 0.5, 4.0) + correlated(generator, 0.1, 1.0)


def scene(seed, *, lidar_sigma=0.03, cover=1.0, dark=None, common=0.0):
    """Truth, and what goes into a fused maplet: SPC heights smoothed and wrong by 10 cm."""
    generator = np.random.default_rng(seed)
    surface = truth(generator)
    spc = ndimage.gaussian_filter(surface, 1.0) + correlated(generator, 0.1, 2.5)
    if dark is not None:
        spc[dark] = np.nan
    lidar = surface + lidar_sigma * generator.normal(size=surface.shape)
    lidar[generator.random(surface.shape) >= cover] = np.nan
    known = np.isfinite(lidar)
    parts = FuseInput(
        name="AA0001",
        grid=GRID,
        spc=Maplet("AA0001", GRID, spc),
        lidar=Constraints(
            lidar, np.where(known, lidar_sigma, np.nan), np.where(known, 4, 0).astype(np.int32)
        ),
        prior=ndimage.gaussian_filter(surface, 8.0),
        common_covariance=common**2 * np.eye(3),
    )
    return surface, parts


def information_of(parts):
    pair = AlignedHeights(parts.lidar.height, parts.spc.height, parts.lidar.sigma, GRID.gsd)
    return estimate_information([pair])


def rms(values):
    return float(np.sqrt(np.nanmean(np.square(values))))
