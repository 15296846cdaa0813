"""The ground that a tiling is to cover, and how much of it has maplets already."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from spcola.arrays import IntArray
from spcola.errors import InvalidValueError
from spcola.grids import Maplet, MapletGrid
from spcola.shape.maplet_cover import covering_grids, sample_step
from spcola.shape.mesh import Mesh
from spcola.shape.samples import sample_surface
from spcola.shape.tiling.circle import Circle
from spcola.shape.uncovered import FACING

# Of grids whose centres are spread so that each point lies within L of one along both axes, the
# spacing is 1.39 L (1.34 to 1.41 on spheres and ellipsoids of 70 to 10,000 grids).
_SPACING = 1.39
_PER_HALF = 20
# Radius of the ground that a grid of a further pass faces, half sides.
_NEAR_NORMAL = 0.3
# Farthest height of a maplet from a sample on the same sheet of the surface, half sides.
_SAME_SHEET = 0.5


class Ground:
    """Samples of a surface, or of a circle on it, and which of them maplets cover.

    Parameters
    ----------
    mesh : Mesh
        Body-fixed.
    gsd : float
        Of the maplets, metres.
    half_size : int
        q of the maplets.
    overlap : float
        Share of a side, 0 … 0.8, that neighbouring maplets have in common: their centres are
        1 − `overlap` sides apart, in the mean (the root of the area for each). Full cover does
        not go below a third.
    circle : Circle, optional
        What is to be covered; everything if not given.

    Raises
    ------
    InvalidValueError
        If a setting is out of range, or there is no surface.
    """

    def __init__(
        self,
        mesh: Mesh,
        gsd: float,
        half_size: int,
        *,
        overlap: float,
        circle: Circle | None = None,
    ) -> None:
        if not 0 <= overlap <= 0.8:
            raise InvalidValueError(f"must lie between 0 and 0.8, not {overlap}", "overlap")
        self._sizes = (gsd, half_size)
        half = gsd * half_size
        within = 2.0 * (1.0 - overlap) / _SPACING
        self._margin = max(0.0, 1.0 - within / (1.0 - 1.0 / _PER_HALF))
        self._step = sample_step(half, self._margin, _PER_HALF)
        # Mean normals need what surrounds the maplets at the rim.
        part = mesh if circle is None else circle.cut(mesh, 2.0 * half)
        self.samples = sample_surface(part, self._step)
        points = self.samples.points
        self.wanted = np.ones(len(points), bool) if circle is None else circle.holds(points)
        if not self.wanted.any():
            raise InvalidValueError("has no surface in the circle", mesh.name)
        self.covered = np.zeros(len(points), dtype=bool)
        self._tree = cKDTree(points)

    @property
    def share(self) -> float:
        """Share of the wanted area that maplets cover, 0 … 1."""
        areas = self.samples.areas
        return float(areas[self.wanted & self.covered].sum() / areas[self.wanted].sum())

    def grids(self) -> list[MapletGrid]:
        """Return grids that cover all wanted ground, evenly spread, from north to south."""
        found = covering_grids(
            self.samples, *self._sizes, (self._step, self._margin), wanted=self.wanted
        )
        return _ordered(found)

    def further_grids(self) -> list[MapletGrid]:
        """Return grids over the wanted ground that no maplet covers yet, without overlap.

        They face the ground near their centres: farther away, it may be another sheet.
        """
        left = self.wanted & ~self.covered
        if not left.any():
            return []
        found = covering_grids(
            self.samples, *self._sizes, (self._step, 0.0), wanted=left, smooth=_NEAR_NORMAL
        )
        return _ordered(found)

    def cover(self, maplet: Maplet, least: float = 0.0) -> bool:
        """Note what a maplet covers, if it adds enough; return whether it does.

        Parameters
        ----------
        maplet : Maplet
        least : float
            Wanted ground that it has to add, as a share of the area of its square.
        """
        seen = self._seen(maplet)
        added = seen[self.wanted[seen] & ~self.covered[seen]]
        side = 2.0 * maplet.grid.half_size * maplet.grid.gsd
        if float(self.samples.areas[added].sum()) < least * side**2:
            return False
        self.covered[seen] = True
        return True

    def _seen(self, maplet: Maplet) -> IntArray:
        """Return the samples over which a maplet has heights, on the same sheet."""
        grid, half = maplet.grid, maplet.grid.half_size * maplet.grid.gsd
        reach = np.hypot(grid.radius, half)
        near = np.array(self._tree.query_ball_point(grid.center, reach), dtype=np.int64)
        near = near[self.samples.normals[near] @ grid.uz >= FACING]
        x, y, height = grid.project(self.samples.points[near])
        inside = np.maximum(np.abs(x), np.abs(y)) <= grid.half_size
        near, x, y, height = near[inside], x[inside], y[inside], height[inside]
        own = grid.interpolated(maplet.height, x, y)
        # NaN, where a corner of the cell has no height, compares as False.
        found: IntArray = near[np.abs(own - height) <= _SAME_SHEET * half]
        return found


def _ordered(grids: list[MapletGrid]) -> list[MapletGrid]:
    """Return grids in bands from north to south and along each to the east: neighbours follow."""
    if not grids:
        return []
    centers = np.array([grid.center for grid in grids])
    band = np.floor(-centers[:, 2] / (2.0 * grids[0].gsd * grids[0].half_size))
    east = np.arctan2(centers[:, 1], centers[:, 0]) % (2.0 * np.pi)
    return [grids[k] for k in np.lexsort((east, band))]
