"""Where the layers of a surface are read from, part by part."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from fusion.service.views.surfaces.cache import LayerCache, Stamp, stamp_of
from spcola.arrays import AnyArray, FloatArray
from spcola.formats.map_store import MapStore
from spcola.formats.maplets import MapParts, sigma_path
from spcola.formats.slope_directions import read_slope_directions, slope_directions_path
from spcola.grids import Maplet, MapletGrid, project_maplet

Index = tuple[Any, Any]
"""Rows (along Uy) and columns (along Ux): slices, or integer arrays (N,)."""


class Source(Protocol):
    """A surface of which parts are read.

    Attributes
    ----------
    grid : MapletGrid
    layers : tuple of str
        Those that may have a value.
    stamp : tuple
        Changes with the files.
    """

    @property
    def grid(self) -> MapletGrid: ...  # noqa: D102
    @property
    def layers(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def stamp(self) -> Stamp: ...  # noqa: D102

    def read(self, layer: str, index: Index) -> AnyArray:
        """Return part of a layer, indexed as a maplet is; NaN where unknown."""
        ...


@dataclass(frozen=True, eq=False)
class MapSource:
    """A .MAP file with its companions of sigmas and of directions of slopes."""

    parts: MapParts
    stamp: Stamp

    @classmethod
    def open(cls, path: Path) -> MapSource:
        """Open the .MAP file `path`."""
        all_files = (path, sigma_path(path), slope_directions_path(path))
        files = [each for each in all_files if each.is_file()]
        return cls(MapParts.open(path), stamp_of(*(files or [path])))

    @property
    def grid(self) -> MapletGrid:
        """Its grid."""
        return self.parts.grid

    @property
    def layers(self) -> tuple[str, ...]:
        """Layers of the files."""
        more = [("sigma", self.parts.has_sigma), ("directions", self._directions_path.is_file())]
        return ("height", "albedo", *(name for name, there in more if there))

    def read(self, layer: str, index: Index) -> AnyArray:
        """Return part of a layer."""
        return self._directions[index] if layer == "directions" else self.parts.read(layer, index)

    @property
    def _directions_path(self) -> Path:
        return slope_directions_path(self.parts.path)

    @cached_property
    def _directions(self) -> FloatArray:
        found = read_slope_directions(self._directions_path, self.grid.half_size)
        return found.count_at_points.astype(np.float64)


@dataclass(frozen=True, eq=False)
class StoredSource:
    """A maplet in the HDF5 file of a folder."""

    store: MapStore[Any]
    folder: Path
    name: str
    grid: MapletGrid
    layers: tuple[str, ...]
    stamp: Stamp

    @classmethod
    def open(
        cls, store: MapStore[Any], folder: Path, name: str, layers: tuple[str, ...]
    ) -> StoredSource:
        """Open the maplet `name` of a folder, whose `layers` are of use."""
        stamp = stamp_of(folder / store.file, folder / f"{name}.MAP")
        return cls(store, folder, name, store.grid(folder, name), layers, stamp)

    def read(self, layer: str, index: Index) -> AnyArray:
        """Return part of a layer."""
        box, inside = _box(index)
        return self.store.part(self.folder, self.name, layer, *box)[inside]


@dataclass(frozen=True, eq=False)
class ArraySource:
    """A surface in memory."""

    grid: MapletGrid
    values: Mapping[str, AnyArray]
    stamp: Stamp

    @property
    def layers(self) -> tuple[str, ...]:
        """Layers that are there."""
        return tuple(self.values)

    def read(self, layer: str, index: Index) -> AnyArray:
        """Return part of a layer."""
        return self.values[layer][index]


@dataclass(frozen=True, eq=False)
class ComparedSource:
    """A surface with the layer ``difference``: its heights less those of another one.

    Attributes
    ----------
    surface, other : Source
        On the same grid.
    """

    surface: Source
    other: Source
    stamp: Stamp = field(default=())

    @property
    def grid(self) -> MapletGrid:
        """The grid of both."""
        return self.surface.grid

    @property
    def layers(self) -> tuple[str, ...]:
        """Layers of the surface, and the difference."""
        return (*self.surface.layers, "difference")

    def read(self, layer: str, index: Index) -> AnyArray:
        """Return part of a layer."""
        if layer != "difference":
            return self.surface.read(layer, index)
        return self.surface.read("height", index) - self.other.read("height", index)


@dataclass(frozen=True, eq=False)
class ProjectedSource:
    """Heights of a surface on another `grid`, projected when they are read, and kept."""

    surface: Source
    grid: MapletGrid
    cache: LayerCache

    layers = ("height",)

    @property
    def stamp(self) -> Stamp:
        """That of the surface."""
        return self.surface.stamp

    def read(self, layer: str, index: Index) -> FloatArray:
        """Return part of the heights."""
        key = (self.stamp, self.grid.center.tobytes(), self.grid.axes.tobytes(), self.grid.gsd)
        return self.cache.find(key, layer, self._projected)[index]

    def _projected(self) -> dict[Hashable, FloatArray]:
        heights = self.surface.read("height", (slice(None), slice(None)))
        maplet = Maplet("other", self.surface.grid, heights)
        return {"height": project_maplet(maplet, self.grid).height}


def compared(surface: Source, other: Source, cache: LayerCache) -> Source:
    """Return `surface` with its difference from `other`, which is projected if its grid differs."""
    stamp = surface.stamp + other.stamp
    if _same_nodes(surface.grid, other.grid):
        return ComparedSource(surface, other, stamp)

    return ComparedSource(surface, ProjectedSource(other, surface.grid, cache), stamp)


def _same_nodes(one: MapletGrid, other: MapletGrid) -> bool:
    """Return whether the nodes of two grids lie at the same places, to a thousandth of a GSD."""
    if one.half_size != other.half_size:
        return False
    corners = np.array([[1, 1], [1, -1], [-1, 1]]) * one.half_size
    apart = [
        grid.center + grid.gsd * (corners[:, :1] * grid.ux + corners[:, 1:] * grid.uy)
        for grid in (one, other)
    ]
    return bool(np.abs(apart[0] - apart[1]).max() < 1e-3 * one.gsd)


def _box(index: Index) -> tuple[tuple[slice, slice], Index]:
    """Return the smallest rectangle around an index, and the index inside of it."""
    if isinstance(index[0], slice):
        return index, (slice(None), slice(None))
    lows = [int(each.min()) for each in index]
    box = [slice(low, int(each.max()) + 1) for low, each in zip(lows, index, strict=True)]
    return (box[0], box[1]), (index[0] - lows[0], index[1] - lows[1])
