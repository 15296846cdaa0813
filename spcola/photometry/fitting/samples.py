"""Brightnesses of ground from which the parameters of a photometric function are fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy import ndimage

from spcola.arrays import AnyArray, BoolArray, FloatArray, IntArray
from spcola.photometry.ground import at_cells
from spcola.photometry.ortho_image import OrthoImage

# Width of a block in pixels of the image: its mean is little changed by blur and misplacement.
_PIXELS = 2.0
# Blocks along a side of a grid, at most: more of them are not independent.
_BLOCKS = 12
# Parts of a side of a grid in which errors of slopes and albedo are taken as common.
_PARTS = 2


@dataclass(frozen=True)
class SampleOptions:
    """Ground that is used.

    Parameters
    ----------
    max_incidence, max_emission : float
        Radians; beyond, shadows and slopes finer than the grid decide the brightness.
    most : int
        Most blocks of a grid in one image; more are thinned evenly.
    """

    max_incidence: float = np.radians(75.0)
    max_emission: float = np.radians(75.0)
    most: int = 24


@dataclass(frozen=True, eq=False)
class BlockSamples:
    """Blocks of cells of one grid in one image.

    Attributes
    ----------
    brightness : (N,) ndarray
        Mean over each block.
    part : (N,) ndarray of int
        Which part of the grid it lies in.
    cosines : (2, N, K) ndarray
        Of incidence and emission of the cells.
    phase : (N, K) ndarray
        Radians.
    albedo : (N, K) ndarray
        Relative.
    """

    brightness: FloatArray
    part: IntArray
    cosines: FloatArray
    phase: FloatArray
    albedo: FloatArray

    def thinned(self, step: int) -> BlockSamples:
        """Return every `step`-th block."""
        some = slice(None, None, step)
        return BlockSamples(
            self.brightness[some],
            self.part[some],
            self.cosines[:, some],
            self.phase[some],
            self.albedo[some],
        )

    def scaled(self, factor: float) -> BlockSamples:
        """Return the blocks with their brightness times `factor`."""
        return replace(self, brightness=factor * self.brightness)


def sample_blocks(
    ortho: OrthoImage, albedo: FloatArray | None = None, options: SampleOptions | None = None
) -> BlockSamples | None:
    """Return the blocks of a grid that an image shows well; None if there are none.

    A block is two pixels wide at least. All its cells, and those within a pixel of them, are seen,
    lit, neither in shadow nor saturated, and within the limits of incidence and emission.

    Parameters
    ----------
    ortho : OrthoImage
    albedo : (R, C) ndarray, optional
        Relative albedo at the grid's points; 1 if not given.
    options : SampleOptions, optional
    """
    view, options = ortho.view, options or SampleOptions()
    finest = float(np.linalg.norm(view.footprint, ord=-2))
    rows, columns = view.phase.shape
    pixel = 1.0 / finest if finest > 0.0 else np.inf
    width = max(np.ceil(_PIXELS * pixel), np.ceil(min(rows, columns) / _BLOCKS))
    if not width <= min(rows, columns):
        return None
    size = int(width)
    light = ortho.brightness if albedo is None else ortho.brightness + 0.0 * albedo
    good = _good_cells(ortho, np.isfinite(light), options)
    good = ndimage.binary_erosion(
        good, np.ones((3, 3), dtype=np.bool_), iterations=max(int(np.ceil(pixel)), 1)
    )
    whole = np.flatnonzero(_blocks(good, size).all(axis=1))
    if not whole.size:
        return None
    layers = view.cos_incidence, view.cos_emission, view.phase, at_cells(ortho.brightness)
    incidence, emission, phase, brightness = (_blocks(one, size)[whole] for one in layers)
    relative: FloatArray = np.ones(phase.shape)
    if albedo is not None:
        relative = _blocks(at_cells(albedo), size)[whole]
    down, across = (_PARTS * np.arange(n // size) // (n // size) for n in (rows, columns))
    part = (_PARTS * down[:, None] + across).ravel()[whole]
    cosines = np.stack([incidence, emission])
    every = BlockSamples(brightness.mean(axis=1), part, cosines, phase, relative)
    return every.thinned(-(-whole.size // options.most))


def _good_cells(ortho: OrthoImage, known: BoolArray, options: SampleOptions) -> BoolArray:
    """Return the cells (R − 1, C − 1) that are well seen and well lit, as all their corners."""
    view = ortho.view
    points = view.seen & view.lit & ortho.exposed & known
    good: BoolArray = points[1:, 1:] & points[1:, :-1] & points[:-1, 1:] & points[:-1, :-1]
    with np.errstate(invalid="ignore"):
        good &= view.cos_incidence > np.cos(options.max_incidence)
        good &= view.cos_emission > np.cos(options.max_emission)
    return good


def _blocks(layer: AnyArray, size: int) -> AnyArray:
    """Return the cells (B, size²) of the whole blocks of a layer."""
    rows, columns = (n // size for n in layer.shape)
    cut = layer[: rows * size, : columns * size].reshape(rows, size, columns, size)
    return cut.swapaxes(1, 2).reshape(rows * columns, size * size)


@dataclass(frozen=True, eq=False)
class PhotometricSamples:
    """Brightnesses of N blocks in several images.

    Attributes
    ----------
    brightness : (N,) ndarray
        Over the mean of its image.
    image, place : (N,) ndarrays of int
        Numbers, from 0, of the image, and of the ground whose errors are common.
    start : (N,) ndarray of int
        First cell of each block in the next three.
    cosines : (2, M) ndarray
    phase : (M,) ndarray
    albedo : (M,) ndarray
        Over the number of cells of the block: sums over a block are means.
    level : float, optional
        That mean, where one scale is common to all images.
    """

    brightness: FloatArray
    image: IntArray
    place: IntArray
    start: IntArray
    cosines: FloatArray
    phase: FloatArray
    albedo: FloatArray
    level: float | None = None

    @classmethod
    def of(
        cls, found: Sequence[tuple[str, int, BlockSamples]], *, calibrated: bool = False
    ) -> Self:
        """Join the blocks of (image, number of the ground) with these samples.

        Parameters
        ----------
        found : sequence
        calibrated : bool
            Whether one scale λ is common to all images.
        """
        names = {} if calibrated else {name: 0 for name, _, _ in found}
        number = {name: k for k, name in enumerate(names)}
        each = [one.brightness.size for _, _, one in found]
        image = np.repeat([number.get(name, 0) for name, _, _ in found], each).astype(np.int64)
        place = np.concatenate([_PARTS**2 * ground + one.part for _, ground, one in found])
        _, place = np.unique(place, return_inverse=True)
        bright = np.concatenate([one.brightness for _, _, one in found])
        level = np.bincount(image, bright) / np.bincount(image)
        cells = np.repeat([one.phase.shape[1] for _, _, one in found], each)
        return cls(
            bright / level[image],
            image,
            place.astype(np.int64),
            np.concatenate([[0], np.cumsum(cells)[:-1]]).astype(np.int64),
            np.concatenate([one.cosines.reshape(2, -1) for _, _, one in found], axis=1),
            np.concatenate([one.phase.ravel() for _, _, one in found]),
            np.concatenate([one.albedo.ravel() / one.albedo.shape[1] for _, _, one in found]),
            float(level[0]) if calibrated else None,
        )

    def __len__(self) -> int:
        return self.brightness.size

    def means(self, layer: FloatArray) -> FloatArray:
        """Return the means (…, N) over blocks of a layer (…, M) times the albedo."""
        means: FloatArray = np.add.reduceat(layer * self.albedo, self.start, axis=-1)
        return means
