"""A surface during photoclinometry: heights of points, albedo of cells."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import ndimage

from spcola.arrays import FloatArray
from spcola.grids import MapletGrid
from spcola.photometry.ground import at_cells
from spcola.photometry.shadows import Relief

# Points around a grid for a spline: what lies beyond them changes it by less than a hundredth.
_BORDER = 4


@dataclass(frozen=True, eq=False)
class Surface:
    """Heights and albedo on a grid.

    Parameters
    ----------
    grid : MapletGrid
    height : (R, C) ndarray
        Of points, metres along Uz.
    albedo : (R − 1, C − 1) ndarray
        Relative albedo of the cells between four points.
    """

    grid: MapletGrid
    height: FloatArray
    albedo: FloatArray

    @property
    def gsd(self) -> float:
        """Grid spacing, metres."""
        return self.grid.gsd

    @cached_property
    def slopes(self) -> FloatArray:
        """∂h/∂x and ∂h/∂y (2, R − 1, C − 1) of cells: means of both edges."""
        return cell_slopes(self.height, self.gsd)

    @cached_property
    def relief(self) -> Relief:
        """What limits how far rays over it have to be followed."""
        return Relief.of(self.height)

    @cached_property
    def _spline(self) -> FloatArray:
        # Beyond its border the surface goes on as it comes: an edge is no top.
        wide = np.pad(self.height, _BORDER, mode="reflect", reflect_type="odd")
        return np.asarray(ndimage.spline_filter(wide, order=3, mode="mirror"))

    def height_at(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return heights (N,) between points, metres, by a cubic spline.

        Parameters
        ----------
        x, y : (N,) ndarrays
            On the grid, from its centre along Ux and Uy, metres.
        """
        places = [along / self.gsd + self.grid.half_size + _BORDER for along in (y, x)]
        return np.asarray(
            ndimage.map_coordinates(self._spline, places, order=3, mode="mirror", prefilter=False)
        )

    def on(self, grid: MapletGrid) -> Surface:
        """Return the surface interpolated to a grid of the same place and another GSD."""
        height = resampled_points(self.height, self.grid, grid)
        ratio = grid.gsd / self.gsd
        offsets = (np.arange(grid.size - 1) + 0.5 - grid.half_size) * ratio
        places = np.clip(offsets + self.grid.half_size - 0.5, 0.0, self.grid.size - 2.0)
        albedo = ndimage.map_coordinates(
            self.albedo, np.meshgrid(places, places, indexing="ij"), order=1, mode="nearest"
        )
        return Surface(grid, height, albedo)

    def point_albedo(self) -> FloatArray:
        """Return the albedo (R, C) of points: the means of their cells."""
        padded = np.pad(self.albedo, 1, mode="edge")
        return at_cells(padded)


def cell_slopes(height: FloatArray, gsd: float) -> FloatArray:
    """Return ∂h/∂x and ∂h/∂y (2, R − 1, C − 1) of the cells between points (R, C)."""
    across, down = np.diff(height, axis=1), np.diff(height, axis=0)
    return np.stack([across[1:] + across[:-1], down[:, 1:] + down[:, :-1]]) / (2.0 * gsd)


def resampled_points(layer: FloatArray, grid: MapletGrid, other: MapletGrid) -> FloatArray:
    """Return a layer (R, C) of `grid` at the points of a grid of the same place, bilinearly."""
    places = other.offsets * other.gsd / grid.gsd + grid.half_size
    return np.asarray(
        ndimage.map_coordinates(
            layer, np.meshgrid(places, places, indexing="ij"), order=1, mode="nearest"
        )
    )
