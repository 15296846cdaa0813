"""A surface as it is looked at: windows and tiles of its layers at overview levels."""

from __future__ import annotations

import hashlib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from fusion.report.maplets import hillshade, slope_deg
from fusion.runtime import usable_cores
from fusion.service.views.places import grid_json
from fusion.service.views.surfaces.cache import LayerCache
from fusion.service.views.surfaces.layers import LAYERS, range_of
from fusion.service.views.surfaces.levels import (
    TILE,
    Rule,
    cells_of,
    levels_of,
    nearest,
    overviews,
    sums_of,
)
from fusion.service.views.surfaces.sources import Index, Source
from spcola.arrays import FloatArray
from spcola.errors import InvalidValueError
from spcola.grids import MapletGrid

# Rows that are read at once to make overview levels; even.
_BAND = 256
# Values from which the range of colours is taken, along a side.
_RANGED = 2 * TILE
SHADED = {"hillshade": hillshade, "slope": slope_deg}
"""Layers that are computed from heights."""


@dataclass(frozen=True, eq=False)
class Surface:
    """A surface of a workspace, of which only what is asked for is read.

    Arrays are images: rows run down along Ux, columns to the right along Uy. Row i and column j of
    a level L are the L × L grid points from i L and j L on. Their middle lies at
    ``x = (j L + (L − 1)/2 − q) gsd`` along Uy, ``y = (q − i L − (L − 1)/2) gsd`` along −Ux; that
    of the last row and column, which have fewer, nearer to their first point.

    Parameters
    ----------
    kind, name : str
    source : Source
    cache : LayerCache
        Keeps overview levels.
    """

    kind: str
    name: str
    source: Source
    cache: LayerCache
    tile_cells: ClassVar[int] = TILE
    """Cells along a side of a tile."""

    @property
    def grid(self) -> MapletGrid:
        """The grid of level 1."""
        return self.source.grid

    @cached_property
    def levels(self) -> tuple[int, ...]:
        """Overview levels: grid points along a side of a cell."""
        return levels_of(self.grid.size)

    @cached_property
    def layers(self) -> tuple[str, ...]:
        """Names of the layers that have a value anywhere."""
        found = [name for name in LAYERS if name in self.source.layers and self._is_of_use(name)]
        shaded = list(SHADED) if "height" in found else []
        return tuple(name for name in LAYERS if name in (*found, *shaded))

    @cached_property
    def etag(self) -> str:
        """A text that changes with the files of the surface."""
        return hashlib.sha256(repr(self.source.stamp).encode()).hexdigest()[:32]

    def describe(self) -> dict[str, Any]:
        """Return grid, layers and levels in JSON types; keys carry units."""
        return {
            "kind": self.kind,
            "name": self.name,
            **grid_json(self.grid),
            "tile": TILE,
            "levels": [self._level_json(level) for level in self.levels],
            "layers": [self._layer_json(name) for name in self.layers],
            "etag": self.etag,
        }

    def window(
        self,
        layer: str,
        *,
        level: int = 1,
        rows: tuple[int, int],
        columns: tuple[int, int],
    ) -> FloatArray:
        """Return a window of a layer, NaN where unknown.

        Parameters
        ----------
        layer : str
            One of `layers`.
        level : int
            One of `levels`.
        rows, columns : (int, int)
            First one, and one beyond the last, inside the level.

        Returns
        -------
        (R, C) float32 ndarray

        Raises
        ------
        InvalidValueError
            If there is no such layer, level or window.
        SpcolaError
            If a file is damaged.
        """
        self._check(layer, level, rows, columns)
        return self._cells(layer, level, rows, columns).astype(np.float32, copy=False)

    def tile(self, layer: str, level: int, row: int, column: int) -> FloatArray:
        """Return a tile (256, 256) of a layer, float32; NaN where unknown or beyond the grid.

        Parameters
        ----------
        layer : str
        level : int
        row, column : int
            Of the tile, from 0.

        Raises
        ------
        InvalidValueError
            If there is no such layer, level or tile.
        """
        self._check_level(level)
        cells = cells_of(self.grid.size, level)
        spans = [(TILE * k, min(TILE * (k + 1), cells)) for k in (row, column)]
        if min(row, column) < 0 or any(low >= high for low, high in spans):
            raise InvalidValueError(f"level {level} has no tile {row}, {column}", self.name)
        window = self.window(layer, level=level, rows=spans[0], columns=spans[1])
        tile = np.full((TILE, TILE), np.nan, dtype=np.float32)
        tile[: window.shape[0], : window.shape[1]] = window
        return tile

    def range(self, layer: str) -> tuple[float, float] | None:
        """Return the range of colours of a layer; None if no value is known."""
        if LAYERS[layer].range == "fixed":
            return LAYERS[layer].fixed
        # Of every picture: to sort the values again takes longer than to draw them.
        key = (self.source.stamp, layer, "range")
        found = self.cache.find(key, 0, lambda: {0: self._found_range(layer)})
        return (float(found[0]), float(found[1])) if found.size else None

    def _found_range(self, layer: str) -> FloatArray:
        """Return the two ends of the range of a layer; an empty array if no value is known."""
        return np.array(range_of(layer, self._whole(layer, self._coarse)) or (), dtype=float)

    def check_layer(self, layer: str) -> None:
        """Refuse a layer that the surface does not have."""
        if layer not in self.layers:
            there = ", ".join(self.layers)
            raise InvalidValueError(f"has no layer {layer!r}", self.name, f"there are: {there}")

    @property
    def _coarse(self) -> int:
        """The finest level that is read whole for ranges of colours."""
        return next(one for one in self.levels if cells_of(self.grid.size, one) <= _RANGED)

    def _is_of_use(self, layer: str) -> bool:
        """Return whether a layer has values; of the albedo, whether it varies."""
        values = self._whole(layer, self._coarse)
        if layer == "albedo":
            known = values[np.isfinite(values)]
            return bool(known.size and np.ptp(known) > 0)
        return bool((values > 0).any() if layer == "count" else np.isfinite(values).any())

    def _whole(self, layer: str, level: int) -> FloatArray:
        """Return all of a layer at a level."""
        whole = (0, cells_of(self.grid.size, level))
        return self._cells(layer, level, whole, whole)

    def _cells(
        self, layer: str, level: int, rows: tuple[int, int], columns: tuple[int, int]
    ) -> FloatArray:
        """Return a window of a layer."""
        if level == 1:
            return self._points(layer, rows, columns)
        key = (self.source.stamp, layer)
        values = self.cache.find(key, level, lambda: self._overviews(layer))
        return values[slice(*rows), slice(*columns)]

    def _points(self, layer: str, rows: tuple[int, int], columns: tuple[int, int]) -> FloatArray:
        """Return grid points as an image; sigma and albedo only where a height is known."""
        if layer in SHADED:
            return self._shaded(layer, rows, columns)
        index: Index = (slice(*columns), slice(*rows))
        values: FloatArray = self.source.read(layer, index).T
        if layer in ("sigma", "albedo"):
            heights = self.source.read("height", index).T
            values = np.where(np.isfinite(heights), values, np.nan)
        return values

    def _shaded(self, layer: str, rows: tuple[int, int], columns: tuple[int, int]) -> FloatArray:
        """Return a window that is computed from heights, one point around it included."""
        size = self.grid.size
        around = [(max(low - 1, 0), min(high + 1, size)) for low, high in (rows, columns)]
        shaded = SHADED[layer](self._points("height", *around).T, self.grid.gsd)
        top, left = rows[0] - around[0][0], columns[0] - around[1][0]
        inside: FloatArray = shaded[top:, left:][: rows[1] - rows[0], : columns[1] - columns[0]]
        return inside

    def _overviews(self, layer: str) -> dict[Any, FloatArray]:
        """Return all levels above 1 of a layer."""
        above, rule = self.levels[1:], LAYERS[layer].rule
        size = self.grid.size
        whole = (0, size)
        if rule is Rule.NEAREST:
            values = self._points(layer, whole, whole)
            return {level: nearest(values, level) for level in above}

        def band(first: int) -> tuple[FloatArray, FloatArray]:
            rows = (first, min(first + _BAND, size))
            values = self._points(layer, rows, whole)
            basis = self._points("height", rows, whole) if rule is Rule.SIGMA else values
            return sums_of(values, np.isfinite(basis))

        with ThreadPoolExecutor(usable_cores()) as pool:
            return dict(overviews(pool.map(band, range(0, size, _BAND)), above, rule))

    def _level_json(self, level: int) -> dict[str, Any]:
        cells = cells_of(self.grid.size, level)
        gsd = self.grid.gsd * level
        return {"level": level, "gsd_m": gsd, "cells": cells, "tiles": cells_of(cells, TILE)}

    def _layer_json(self, name: str) -> dict[str, Any]:
        kind = LAYERS[name]
        return {
            "name": name,
            "text": kind.text,
            "unit": kind.unit,
            "levels": kind.rule.value,
            "colours": kind.colours,
            "range": self.range(name),
        }

    def _check(
        self, layer: str, level: int, rows: tuple[int, int], columns: tuple[int, int]
    ) -> None:
        """Refuse a layer, level or window that there is not."""
        self._check_level(level)
        if layer not in self.source.layers and layer not in SHADED:
            self.check_layer(layer)
        cells = cells_of(self.grid.size, level)
        for what, (low, high) in (("rows", rows), ("columns", columns)):
            if not 0 <= low < high <= cells:
                raise InvalidValueError(
                    f"{what} {low} to {high} are not inside 0 to {cells} of level {level}",
                    self.name,
                )

    def _check_level(self, level: int) -> None:
        if level not in self.levels:
            there = ", ".join(map(str, self.levels))
            raise InvalidValueError(f"has no level {level}", self.name, f"there are: {there}")
