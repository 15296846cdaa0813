"""An image over a grid: its pixels there, and where points of the grid are projected."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import ndimage

from spcola.arrays import AnyArray, BoolArray, FloatArray
from spcola.camera import SpcImage, project_image
from spcola.compilation import compiled
from spcola.grids import MapletGrid
from spcola.photometry.ground import Ground, at_cells
from spcola.photometry.ortho_image import stop_at_other_ground
from spcola.photometry.photoclinometry.surface import Surface, resampled_points
from spcola.photometry.secondary_light import SecondaryLight
from spcola.photometry.shadows import cast_shadow, hidden
from spcola.shape import RayCaster

# Pixels around the ground in a window.
_MARGIN = 3
# Points are raised by so many GSDs for derivatives: far less than the distance, far more than the
# rounding of a pixel.
_RISE = 1e-3
# Pixels are averaged in blocks of at most this side, cells: relief of a cell hardly varies in one,
# and a pixel costs as much as a cell.
_BLOCK = 0.75
# Saturated pixels of a line or column that bloom, and pixels aside that their charge reaches: with
# fringes of 1.8 and 1.3 times the brightness there, slopes of a plane with waves are wrong by 0.047
# of theirs if these count, by 0.015 if not, as without blooming.
_ROW, _SPILL = 3, 2


@dataclass(frozen=True, eq=False)
class GridPoints:
    """Points of a grid: what the windows of all images over it share.

    Attributes
    ----------
    grid : MapletGrid
    height : (R, C) ndarray
        Metres, all known.
    points, raised : (R, C, 3) ndarrays
        Body-fixed, metres, and the same a little higher.
    cells : (3, R − 1, C − 1) ndarray
        Middles of cells from the grid's centre, along its axes, metres.
    """

    grid: MapletGrid
    height: FloatArray
    points: FloatArray
    raised: FloatArray
    cells: FloatArray

    @classmethod
    def of(cls, grid: MapletGrid, height: FloatArray) -> GridPoints:
        """Return the points of a grid at heights (R, C), metres, all known."""
        points = grid.points(height)
        middles = grid.gsd * (np.arange(grid.size - 1) + 0.5 - grid.half_size)
        cells = np.stack([*np.meshgrid(middles, middles), at_cells(height)])
        return cls(grid, np.array(height), points, points + _RISE * grid.gsd * grid.uz, cells)


@dataclass(frozen=True, eq=False)
class ImageWindow:
    """An image over a grid.

    Attributes
    ----------
    name : str
    pixels : (H, W) ndarray
        Brightness in a window of the image, averaged over blocks of pixels.
    usable : (H, W) ndarray of bool
        Blocks whose pixels are all between the image's thresholds, neither dark as shadow nor
        saturated, and not next to a row of saturated ones.
    block : int
        Pixels along the side of a block; 1 where pixels are no finer than cells.
    u, v : (R, C) ndarrays
        Sample and line of each point at `height`, in blocks; number k of the window reaches from k
        to k + 1.
    up_u, up_v : (R, C) ndarrays
        Derivatives of sample and line by the height, pixels a metre.
    height : (R, C) ndarray
        Metres.
    sun : (3,) ndarray
        Unit vector along the grid's axes.
    eye : (3, R − 1, C − 1) ndarray
        Unit vectors from the cells to the camera, along the grid's axes.
    phase : (R − 1, C − 1) ndarray
        Radians.
    camera : (3,) ndarray
        Its place along the grid's axes from the grid's first point: grid steps, grid steps, metres.
    facing : float
        Sign of the area, in (sample, line), of cells that face the camera.
    open_seen, open_lit : (R − 1, C − 1) ndarrays
        Shares of cells that ground beyond the grid does not hide, and does not shade.
    secondary : two ndarrays, optional
        Directions (K, 3) along the grid's axes and irradiances (K, R − 1, C − 1) of the light from
        other ground by which it shows what the Sun does not light, and nothing else.
    """

    name: str
    pixels: FloatArray
    usable: BoolArray
    block: int
    u: FloatArray
    v: FloatArray
    up_u: FloatArray
    up_v: FloatArray
    height: FloatArray
    sun: FloatArray
    eye: FloatArray
    phase: FloatArray
    camera: FloatArray
    facing: float
    open_seen: FloatArray
    open_lit: FloatArray
    secondary: tuple[FloatArray, FloatArray] | None = None

    @classmethod
    def of(
        cls,
        image: SpcImage,
        ground: GridPoints,
        open_ground: tuple[FloatArray, FloatArray],
        *,
        finest_m: float | None = None,
        light: SecondaryLight | None = None,
    ) -> ImageWindow | None:
        """Cut a window out of an image with pixels; None if it does not show the grid.

        Parameters
        ----------
        image : SpcImage
        ground : GridPoints
            Their heights may change later by far less than the distance.
        open_ground : two (R − 1, C − 1) ndarrays
            `open_seen` and `open_lit`.
        finest_m : float, optional
            GSD for which blocks of pixels are small enough, metres; that of the grid if not given.
        light : SecondaryLight, optional
            By which it shows ground in the shade.
        """
        grid = ground.grid
        pixel, line = project_image(image, ground.points)
        if image.pixels is None or not np.isfinite(pixel + line).all():
            return None
        cell = 1.0 if finest_m is None else finest_m / grid.gsd
        block = _block_of(pixel, line, cell)
        shape = image.camera.height, image.camera.width
        window = tuple(
            _span(place, size, block) for place, size in zip((line, pixel), shape, strict=True)
        )
        if any(one.start >= one.stop for one in window):
            return None
        pixels = np.asarray(image.pixels[window], dtype=np.float64)
        low, high = image.thresholds
        usable = (pixels > low) & (pixels < high)
        if light is None:
            usable &= ~_bloomed(pixels >= high)
        raised = project_image(image, ground.raised)
        up = [
            (one - other) / (_RISE * grid.gsd)
            for one, other in zip(raised, (pixel, line), strict=True)
        ]
        camera = grid.axes @ (image.position - grid.center)
        away = camera[:, None, None] - ground.cells
        eye = away / np.sqrt(np.sum(away * away, axis=0))
        sun = grid.axes @ image.sun
        u, v = (
            (place - 0.5 - one.start) / block
            for place, one in zip((pixel, line), window[::-1], strict=True)
        )
        across, down = (np.array([w[j] - w[0, 0] for w in (u, v)]) for j in ((0, -1), (-1, 0)))
        facing = float(np.sign(across[0] * down[1] - across[1] * down[0]))
        return cls(
            image.name, _in_blocks(pixels, block).mean(axis=(1, 3)),
            np.asarray(_in_blocks(usable, block).all(axis=(1, 3))), block, u, v,
            up[0], up[1], ground.height, sun, eye,
            np.arccos(np.clip(np.tensordot(sun, eye, 1), -1.0, 1.0)),
            camera / [grid.gsd, grid.gsd, 1.0] + [grid.half_size, grid.half_size, 0.0], facing,
            *open_ground, None if light is None else light.on_cells(grid),
        )  # fmt: skip

    @property
    def elevation_sine(self) -> float:
        """Sine of the elevation of the light above the plane of the grid."""
        if self.secondary is None:
            return float(self.sun[2])
        directions, irradiance = self.secondary
        light = irradiance.mean(axis=(1, 2)) @ directions
        return float(light[2] / np.linalg.norm(light))

    def lights(self) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
        """Yield direction (3,), phase (R − 1, C − 1) and irradiance of each source of light."""
        if self.secondary is None:
            yield self.sun, self.phase, np.ones_like(self.phase)
            return
        for direction, irradiance in zip(*self.secondary, strict=True):
            cosine = np.tensordot(direction, self.eye, 1)
            yield direction, np.arccos(np.clip(cosine, -1.0, 1.0)), irradiance

    def turned(self) -> ImageWindow:
        """Return the same with its light on the other side of the grid's normal.

        Ground beyond the grid does not shade it then: a Sun that is stated wrong has its shadows in
        the wrong place.
        """
        half_turn = np.array([-1.0, -1.0, 1.0])
        if self.secondary is not None:
            directions, irradiance = self.secondary
            return replace(self, secondary=(directions * half_turn, irradiance))
        return replace(self, sun=self.sun * half_turn, open_lit=np.ones_like(self.open_lit))

    def pixel_m(self, gsd: float) -> float:
        """Return the side of a square of the area of a pixel on the plane of the grid, metres."""
        across, down = (
            np.array([w[j] - w[0, 0] for w in (self.u, self.v)]) / (self.u.shape[axis] - 1)
            for axis, j in ((1, (0, -1)), (0, (-1, 0)))
        )
        return gsd / (self.block * float(np.sqrt(abs(across[0] * down[1] - across[1] * down[0]))))

    def places(self, height: FloatArray, shift: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return sample and line (R, C), in blocks, of points at other heights.

        `shift` (2,) is in pixels.
        """
        u, v = np.empty((2, *height.shape))
        rise, block = height - self.height, float(self.block)
        _move(self.u, self.up_u, rise, float(shift[0]), block, u)
        _move(self.v, self.up_v, rise, float(shift[1]), block, v)
        return u, v

    @cached_property
    def lift(self) -> FloatArray:
        """Derivatives of sample and line (2, R − 1, C − 1) of cells by height, pixels a metre."""
        return np.stack([at_cells(self.up_u), at_cells(self.up_v)])

    def seen_and_lit(self, surface: Surface) -> tuple[FloatArray, FloatArray]:
        """Return the shares (R − 1, C − 1) of each cell that the camera sees, and that are lit.

        Those that the Sun does not light are lit by secondary light.
        """
        seen, lit = np.empty(self.open_seen.shape), np.empty(self.open_lit.shape)
        _uncover(self.open_seen, hidden(surface.height, self.camera, surface.relief), seen)
        step = self.sun * [1.0, 1.0, surface.gsd]
        _uncover(self.open_lit, cast_shadow(surface.height, step, surface.relief), lit)
        return seen, lit if self.secondary is None else 1.0 - lit


@compiled
def _move(
    at: FloatArray, up: FloatArray, rise: FloatArray, shift: float, block: float, out: FloatArray
) -> None:
    """Fill `out` (R, C) with places `at`, in blocks, changed by a rise and a shift in pixels."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = at[i, j] + (up[i, j] * rise[i, j] + shift) / block


@compiled
def _uncover(whole: FloatArray, covered: BoolArray, shares: FloatArray) -> None:
    """Fill `shares` (R − 1, C − 1) with those of `whole` in no covered points (R, C)."""
    for i in range(whole.shape[0]):
        for j in range(whole.shape[1]):
            corners = covered[i, j] + covered[i, j + 1] + covered[i + 1, j] + covered[i + 1, j + 1]
            shares[i, j] = whole[i, j] * (1.0 - 0.25 * corners)


def _block_of(pixel: FloatArray, line: FloatArray, cell: float) -> int:
    """Return the side of blocks for sample and line (R, C) of the points of a grid.

    `cell` is the side of the cells for which they are small enough, steps of the grid.
    """
    cells = pixel.shape[0] - 1
    extents = [np.hypot(w[0, -1] - w[0, 0], w[-1, 0] - w[0, 0]) / cells for w in (pixel, line)]
    return max(1, int(_BLOCK * cell * min(extents)))


def _span(place: FloatArray, size: int, block: int) -> slice:
    """Return the whole blocks around places in an image of `size` lines or samples."""
    margin = _MARGIN * block
    first, last = max(int(place.min()) - margin, 0), min(int(place.max()) + margin, size)
    return slice(first, first + (last - first) // block * block)


def _bloomed(saturated: BoolArray) -> BoolArray:
    """Return the pixels (H, W) at or next to rows of saturated ones, whose charge spills over.

    Single saturated pixels, as hot ones are, do not spill.
    """
    if not saturated.any():
        return saturated
    row = np.ones((1, _ROW), dtype=np.bool_)
    rows = [ndimage.binary_opening(saturated, one) for one in (row, row.T)]
    around = np.ones((2 * _SPILL + 1, 2 * _SPILL + 1), dtype=np.bool_)
    found: BoolArray = ndimage.binary_dilation(rows[0] | rows[1], around)
    return found


def _in_blocks(layer: AnyArray, block: int) -> AnyArray:
    """Return a layer (H, W) as (H / block, block, W / block, block)."""
    height, width = layer.shape
    return layer.reshape(height // block, block, width // block, block)


def open_ground(
    image: SpcImage,
    grid: MapletGrid,
    height: FloatArray,
    beyond: Sequence[RayCaster],
    square: MapletGrid,
) -> tuple[FloatArray, FloatArray]:
    """Return where ground beyond a grid neither hides nor shades its points (R, C), 0 or 1.

    Parameters
    ----------
    image : SpcImage
    grid : MapletGrid
    height : (R, C) ndarray
        Of its points, metres.
    beyond : sequence of RayCaster
        Surfaces around.
    square : MapletGrid
        Of the same place, as fine or finer: its border is where other ground begins.
    """
    seen, lit = np.ones((2, *grid.shape), dtype=np.bool_)
    if beyond:
        ground = Ground.of(grid, height)
        eye, sun = ground.eye(image), np.broadcast_to(ground.sun(image), (*grid.shape, 3))
        for surface in beyond:
            stop_at_other_ground(seen, surface, ground, eye, square)
            stop_at_other_ground(lit, surface, ground, sun, square)
    return seen.astype(np.float64), lit.astype(np.float64)


def window_over(
    image: SpcImage,
    ground: GridPoints,
    coarse: MapletGrid,
    open_ground: tuple[FloatArray, FloatArray],
    *,
    finest_m: float | None = None,
    light: SecondaryLight | None = None,
) -> ImageWindow | None:
    """Return the window of an image over a grid; None if it does not show the grid.

    Parameters
    ----------
    image : SpcImage
    ground : GridPoints
    coarse : MapletGrid
        Of the same place.
    open_ground : two ndarrays
        What the function of this name gives for the points of `coarse`.
    finest_m : float, optional
    light : SecondaryLight, optional
        As in :meth:`ImageWindow.of`.
    """
    seen, lit = (_shares(points, coarse, ground.grid) for points in open_ground)
    return ImageWindow.of(image, ground, (seen, lit), finest_m=finest_m, light=light)


def _shares(points: FloatArray, coarse: MapletGrid, grid: MapletGrid) -> FloatArray:
    """Return shares (R − 1, C − 1) of the cells of a grid from those at points of a coarser one."""
    # The rule: nothing beyond the grid hides or shades it.
    if (points == 1.0).all():
        return np.ones((grid.size - 1,) * 2)
    return at_cells(resampled_points(points, coarse, grid))
