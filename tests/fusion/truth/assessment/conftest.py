"""A truth of which everything is known by formula."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fusion.truth.presets import MissionSettings
from spcola.grids import MapletGrid
from spcola.truth.body import SurfacePoints


class Ellipsoid:
    """An ellipsoid about O; nearest points by Newton's method on Lagrange's multiplier."""

    def __init__(self, *axes: float) -> None:
        self.axes = np.array(axes if len(axes) == 3 else axes * 3)

    def radius(self, directions):
        return np.linalg.norm(directions, axis=1) / np.linalg.norm(directions / self.axes, axis=1)

    def points(self, directions):
        return self.radius(directions)[:, None] * directions

    def nearest(self, points) -> SurfacePoints:
        square, t = self.axes**2, np.zeros(len(points))
        for _ in range(50):
            below = square + t[:, None]
            value = np.sum(square * points**2 / below**2, axis=1) - 1.0
            t -= value / np.sum(-2.0 * square * points**2 / below**3, axis=1)
        foot = square * points / (square + t[:, None])
        normals = foot / square
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return SurfacePoints(np.sum((points - foot) * normals, axis=1), foot, normals)

    def heights(self, grid: MapletGrid):
        nodes = grid.points(np.zeros(grid.shape)) / self.axes
        up = grid.uz / self.axes
        a, b = up @ up, nodes @ up
        c = np.sum(nodes**2, axis=-1) - 1.0
        with np.errstate(invalid="ignore"):
            return (-b + np.sqrt(b**2 - a * c)) / a

    def heights_near(self, grid: MapletGrid, model):
        return self.heights(grid)

    def terrain(self, directions, *, smallest):
        return np.zeros(len(directions), dtype=np.uint8)


@pytest.fixture
def top() -> Ellipsoid:
    """A body without any symmetry but its planes'."""
    return Ellipsoid(80.0, 75.0, 70.0)


@pytest.fixture
def ball() -> Ellipsoid:
    """A sphere of 75 m."""
    return Ellipsoid(75.0)


@pytest.fixture(scope="session")
def one_scan() -> MissionSettings:
    """A mission of one scan, which has a whole SPC solution nevertheless."""
    tiny = MissionSettings.tiny()
    return replace(
        tiny,
        passes=replace(tiny.passes, count=4),
        lidar=replace(tiny.lidar, spacing=5.0),
        solution=replace(tiny.solution, maplets=12),
    )
