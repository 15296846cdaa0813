"""Models to assess: maplets of any kind, or a mesh."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, Protocol

import numpy as np

from spcola.arrays import FloatArray, IntArray
from spcola.grids import Maplet, MapletGrid
from spcola.math import lattice
from spcola.shape import Mesh, RayCaster, shape_heights

Frame = Literal["spc", "body"]
"""Coordinates of a model: the SPC solution's, or the true body-fixed ones (the lidar's)."""

# A patch of a mesh reaches at most this share of the mean radius from its centre: further away
# the surface curves away from the grid.
_WIDEST_PATCH = 0.25
_PATCH_HALF_SIZE = 32


class Model(Protocol):
    """A model of the body's surface."""

    @property
    def name(self) -> str:
        """Name in tables."""

    @property
    def frame(self) -> Frame:
        """Its coordinates."""

    @property
    def mesh(self) -> Mesh | None:
        """The surface as a mesh, if it is one."""

    def keys(self, most: int) -> Sequence[str]:
        """Return the patches to compare, at most `most`, evenly taken from all."""

    def patch(self, key: str) -> Maplet:
        """Return one patch."""


@dataclass(frozen=True, eq=False)
class MapletModel:
    """Maplets, mapolas or bigmaps: their names, and a function that loads one.

    Parameters
    ----------
    name : str
    names : sequence of str
    load : callable
        Returns the maplet of a name, in the frame of the model.
    frame : {"spc", "body"}
    """

    name: str
    names: Sequence[str]
    load: Callable[[str], Maplet]
    frame: Frame = "spc"
    mesh: None = None

    def keys(self, most: int) -> Sequence[str]:
        """Return the names of maplets to compare."""
        return [self.names[k] for k in evenly(len(self.names), most)]

    def patch(self, key: str) -> Maplet:
        """Return the maplet of that name."""
        return self.load(key)


@dataclass(frozen=True, eq=False)
class MeshModel:
    """A mesh; its heights are sampled by rays on squares over the body.

    Parameters
    ----------
    name : str
    mesh : Mesh
    frame : {"spc", "body"}
    """

    name: str
    mesh: Mesh
    frame: Frame = "spc"

    @cached_property
    def caster(self) -> RayCaster:
        """Ray caster of the mesh."""
        return RayCaster(self.mesh)

    @cached_property
    def spacing(self) -> float:
        """Distance between vertices, metres: the square root of the mean area of one vertex."""
        area = float(np.linalg.norm(self.mesh.area_vectors, axis=1).sum())
        return float(np.sqrt(area / max(len(self.mesh.vertices), 1)))

    @cached_property
    def half_size(self) -> int:
        """Half-size of the squares, in steps of the spacing."""
        reach = _WIDEST_PATCH * float(np.median(np.linalg.norm(self.mesh.vertices, axis=1)))
        return int(np.clip(reach / self.spacing, 8, _PATCH_HALF_SIZE))

    @cached_property
    def directions(self) -> FloatArray:
        """Directions (N, 3) of squares that cover the mesh about once."""
        width = 2.0 * self.half_size * self.spacing
        area = float(np.linalg.norm(self.mesh.area_vectors, axis=1).sum())
        return lattice(max(16, int(np.ceil(area / width**2))))

    def keys(self, most: int) -> Sequence[str]:
        """Return the numbers of the squares to compare."""
        return [str(k) for k in evenly(len(self.directions), most)]

    def patch(self, key: str) -> Maplet:
        """Return the heights over one square, facing the mesh's mean plane there."""
        direction = self.directions[int(key)]
        start = 2.0 * float(np.linalg.norm(self.mesh.vertices, axis=1).max())
        middle = self.caster.cast(start * direction, -direction[None]).points[0]
        if not np.isfinite(middle).all():
            middle = 0.5 * start * direction
        coarse = MapletGrid.facing(middle, direction, self.spacing * self.half_size / 4.0, 4)
        normal = self._normal(coarse, direction)
        grid = MapletGrid.facing(middle, normal, self.spacing, self.half_size)
        height = shape_heights(self.caster, grid, reach=2.0 * grid.radius)
        return Maplet(f"{self.name} {key}", grid, height)

    def _normal(self, grid: MapletGrid, direction: FloatArray) -> FloatArray:
        """Return the normal of the mesh's mean plane over a coarse grid; else `direction`."""
        points = grid.points(shape_heights(self.caster, grid, reach=2.0 * grid.radius))
        points = points[np.isfinite(points[..., 0])]
        if len(points) < 12:
            return direction
        normal = np.linalg.svd(points - points.mean(axis=0))[2][2]
        return normal if normal @ direction > 0 else -normal


def evenly(count: int, most: int) -> list[int]:
    """Return at most `most` indices, evenly taken from 0 … `count` − 1."""
    if count <= most:
        return list(range(count))
    chosen: IntArray = np.linspace(0, count - 1, most).round().astype(np.int64)
    return chosen.tolist()


def squares(maplet: Maplet, half_size: int, most: int) -> list[Maplet]:
    """Cut a large map into at most `most` squares of `half_size`; a small map is returned whole.

    Incomplete squares at the right and lower edges are left out.
    """
    grid = maplet.grid
    if grid.half_size <= half_size:
        return [maplet]
    size = 2 * half_size + 1
    starts = range(0, grid.size - size + 1, size)
    corners = [(row, column) for row in starts for column in starts]
    return [_square(maplet, *corners[k], half_size) for k in evenly(len(corners), most)]


def _square(maplet: Maplet, row: int, column: int, half_size: int) -> Maplet:
    grid = maplet.grid
    cut = (slice(row, row + 2 * half_size + 1), slice(column, column + 2 * half_size + 1))
    m, n = row + half_size - grid.half_size, column + half_size - grid.half_size
    center = grid.center + grid.gsd * (m * grid.uy + n * grid.ux)
    part = MapletGrid(center, grid.axes, grid.gsd, half_size)
    layers = (maplet.height[cut], maplet.albedo[cut], maplet.sigma[cut])
    return Maplet(maplet.name, part, *layers, center_sigma=maplet.center_sigma)
