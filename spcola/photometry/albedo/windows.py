"""A grid of fixed heights in windows, and images over them: memory does not grow with the grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from spcola.arrays import AnyArray, BoolArray, FloatArray
from spcola.camera import SpcImage
from spcola.grids import Maplet, MapletGrid
from spcola.grids.gaps import bridged, bridged_mask
from spcola.photometry.ground import at_cells
from spcola.photometry.photoclinometry.image_equations import ImageState
from spcola.photometry.photoclinometry.image_window import GridPoints, ImageWindow, open_ground
from spcola.photometry.photoclinometry.surface import Surface, resampled_points
from spcola.photometry.shadows import cast_shadow, hidden
from spcola.shape import RayCaster

# Cells of the inner square of a window, and around it: pixels at its edge need all their ground.
_INNER, _MARGIN = 96, 8
# GSDs of the grid on which other ground is looked for.
_COARSE = 4
# Widest gap of the heights that is bridged, cells: single returns are missing in mapolas.
_GAP = 2
# Shares of cells are kept in bytes: all quarters are exact.
_WHOLE = 200.0


@dataclass(frozen=True, eq=False)
class Window:
    """A square of cells.

    Parameters
    ----------
    grid : MapletGrid
        Of its points.
    row, column : int
        Of its first cell.
    inner : tuple of 2 slice
        Rows and columns of the whole grid that it determines.
    whole : int
        Cells along a side of the whole grid.
    """

    grid: MapletGrid
    row: int
    column: int
    inner: tuple[slice, slice]
    whole: int

    @property
    def cells(self) -> tuple[slice, slice]:
        """Rows and columns of its cells in the whole grid."""
        side = self.grid.size - 1
        return slice(self.row, self.row + side), slice(self.column, self.column + side)

    @property
    def own(self) -> tuple[slice, slice]:
        """Rows and columns of the inner square in the window."""
        first = (self.row, self.column)
        return tuple(  # type: ignore[return-value]
            slice(one.start - start, one.stop - start)
            for one, start in zip(self.inner, first, strict=True)
        )

    @property
    def inside(self) -> BoolArray:
        """Mask (R − 1, C − 1) of the inner square."""
        mask = np.zeros((self.grid.size - 1,) * 2, dtype=np.bool_)
        mask[self.own] = True
        return mask

    def _axis(self, first: int) -> tuple[float, float]:
        """Centre and half-width along an axis, of the whole grid from −1 to 1."""
        half = (self.grid.size - 1) / self.whole
        return 2.0 * first / self.whole + half - 1.0, half

    def state(self, image: ImageState) -> ImageState:
        """Return the state of an image of the whole grid as one of the window."""
        (x, wide), (y, high) = self._axis(self.column), self._axis(self.row)
        middle = 1.0 + float(image.gradient @ [x, y])
        gradient = image.gradient * [wide, high] / middle
        return replace(image, scale=image.scale * middle, gradient=gradient)

    @property
    def to_whole(self) -> FloatArray:
        """The derivatives by the nuisance parameters of the whole grid (5) from the window's (5).

        As the equations have them: brightness, and brightness times place along x and y.
        """
        (x, wide), (y, high) = self._axis(self.column), self._axis(self.row)
        turned = np.eye(5)
        turned[1, :2], turned[2, [0, 2]] = (x, wide), (y, high)
        return turned


def windows_of(grid: MapletGrid) -> tuple[Window, ...]:
    """Return windows whose inner squares cover the cells of a grid once."""
    whole = grid.size - 1
    side = _INNER + 2 * _MARGIN
    if whole <= side:
        return (Window(grid, 0, 0, (slice(0, whole), slice(0, whole)), whole),)
    edges = np.linspace(0, whole, -(-whole // _INNER) + 1).astype(int).tolist()
    blocks = [slice(*pair) for pair in pairwise(edges)]
    starts = [min(max(block.start - _MARGIN, 0), whole - side) for block in blocks]
    found = []
    for rows, row in zip(blocks, starts, strict=True):
        for columns, column in zip(blocks, starts, strict=True):
            down, across = (first + side // 2 - grid.half_size for first in (row, column))
            center = grid.center + grid.gsd * (down * grid.uy + across * grid.ux)
            part = replace(grid, center=center, half_size=side // 2)
            found.append(Window(part, row, column, (rows, columns), whole))
    return tuple(found)


class _FixedWindow(ImageWindow):
    """An image over ground that does not change: `open_seen` and `open_lit` have all shadows."""

    def seen_and_lit(self, surface: Surface) -> tuple[FloatArray, FloatArray]:
        """Return the shares of cells as they were found over the whole grid."""
        del surface
        return self.open_seen, self.open_lit


@dataclass(frozen=True, eq=False)
class FixedGround:
    """Heights of a grid, and K images with where they see its cells, lit and unlit.

    Attributes
    ----------
    grid : MapletGrid
    height : (R, C) ndarray
        Metres; narrow gaps bridged, all known.
    known : (R − 1, C − 1) ndarray of bool
        Cells with heights at all corners.
    images : sequence of SpcImage
    seen, lit : (K, R − 1, C − 1) ndarrays of bytes
    """

    grid: MapletGrid
    height: FloatArray
    known: BoolArray
    images: Sequence[SpcImage]
    seen: AnyArray
    lit: AnyArray

    @classmethod
    def of(
        cls, ground: Maplet, images: Sequence[SpcImage], beyond: RayCaster | None
    ) -> FixedGround:
        """Find what ground within and beyond a grid hides and shades."""
        grid, height = ground.grid, bridged(ground.height)
        points = bridged_mask(ground.valid, _GAP)
        known = points[1:, 1:] & points[1:, :-1] & points[:-1, 1:] & points[:-1, :-1]
        shares = np.zeros((2, len(images), grid.size - 1, grid.size - 1), dtype=np.uint8)
        coarse = grid.with_gsd(_COARSE * grid.gsd)
        rough = resampled_points(height, grid, coarse)
        for k, image in enumerate(images):
            far = open_ground(image, coarse, rough, () if beyond is None else (beyond,), grid)
            near = _open_within(image, grid, np.where(points, height, np.nan))
            for share, outer, inner in zip(shares, far, near, strict=True):
                both = at_cells(resampled_points(outer, coarse, grid)) * at_cells(inner)
                share[k] = np.rint(_WHOLE * both * known)
        return cls(grid, height, known, images, *shares)

    def views(self, window: Window) -> list[tuple[int, ImageWindow]]:
        """Return number and window of each image that shows ground of a window."""
        surface, found = self.surface(window, np.ones(self.known.shape)), []
        ground = GridPoints.of(surface.grid, surface.height)
        for k, image in enumerate(self.images):
            seen, lit = (layer[k][window.cells] / _WHOLE for layer in (self.seen, self.lit))
            if seen.any() and (view := _FixedWindow.of(image, ground, (seen, lit))):
                found.append((k, view))
        return found

    def surface(self, window: Window, albedo: FloatArray) -> Surface:
        """Return a window of the surface with the albedo (R − 1, C − 1) of the whole grid."""
        rows, columns = window.cells
        points = slice(rows.start, rows.stop + 1), slice(columns.start, columns.stop + 1)
        return Surface(window.grid, self.height[points], albedo[window.cells])

    def windows(self) -> list[Window]:
        """Return the windows that contain known ground."""
        return [one for one in windows_of(self.grid) if self.known[one.inner].any()]


def _open_within(
    image: SpcImage, grid: MapletGrid, height: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return where a grid's own ground neither hides nor shades its points (R, C), 0 or 1.

    Nothing stands where heights are unknown (NaN).
    """
    camera = grid.axes @ (image.position - grid.center) / [grid.gsd, grid.gsd, 1.0]
    eye = camera + np.array([grid.half_size, grid.half_size, 0.0])
    sun = grid.axes @ image.sun
    shade = cast_shadow(height, sun * [1.0, 1.0, grid.gsd])
    return 1.0 - hidden(height, eye), 1.0 - shade
