"""Returns on made-up ground, and the grid over them."""

from __future__ import annotations

import numpy as np

from lidar.gridding.rejection import RejectionOptions
from lidar.scans import Returns
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
