"""Areas whose brightness most images leave over: an albedo, or relief, that priors forbid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from spcola.arrays import BoolArray, FloatArray, IntArray
from spcola.photometry.ground import at_cells
from spcola.photometry.photoclinometry.comparison import compare_on_grid
from spcola.photometry.photoclinometry.image_equations import ImageState
from spcola.photometry.photoclinometry.image_window import ImageWindow
from spcola.photometry.photoclinometry.options import PhotoclinometryOptions
from spcola.photometry.photoclinometry.surface import Surface

# Relative residual, median over the images that show a point, beyond which it is left over; fewest
# of these, and fewest connected points of an area. Relief that the grid does not resolve leaves 8
# points at most on `mini` and 11 on `bennu`; an area of 113 points of three times the albedo 125.
_LEFT, _IMAGES, _POINTS = 0.2, 3, 25
# Factor on the albedo from which on an area does not rise from round to round: nearly all of its
# pixels are outliers. Fewest points of such an area on a coarse grid.
_FAR, _COARSE_POINTS = 2.0, 4
# Most images that are compared.
_ASKED = 12


def area_left_over(
    windows: Sequence[ImageWindow | None],
    surface: Surface,
    states: Sequence[ImageState],
    options: PhotoclinometryOptions,
) -> float:
    """Return the relative residual of the largest area that most images leave over.

    It is the median over images and points: above 0 the area is brighter than expected. NaN if
    there is no area of 25 points in which it is beyond 0.2.

    Parameters
    ----------
    windows : sequence of ImageWindow or None
    surface : Surface
    states : sequence of ImageState
        Of the windows.
    options : PhotoclinometryOptions
    """
    middle = _residuals(windows, surface, states, options)
    sides = [_areas(middle > _LEFT), _areas(middle < -_LEFT)]
    side = max(sides, key=_Areas.largest)
    if side.largest() < _POINTS:
        return float("nan")
    return float(np.median(middle[side.labels == 1 + int(side.sizes.argmax())]))


def albedo_of_areas(
    windows: Sequence[ImageWindow | None],
    surface: Surface,
    states: Sequence[ImageState],
    options: PhotoclinometryOptions,
) -> FloatArray:
    """Return the albedo (R − 1, C − 1), that of areas which are far off as most images show it.

    These are areas of a coarse grid that are more than twice as bright as expected, or less than
    half as bright: from round to round their albedo would hardly change.

    Parameters
    ----------
    windows, surface, states, options
        As of :func:`area_left_over`.
    """
    factor = 1.0 + _residuals(windows, surface, states, options)
    for far in (factor > _FAR, factor < 1.0 / _FAR):
        side = _areas(far)
        large = np.concatenate([[False], side.sizes >= _COARSE_POINTS])
        factor = np.where(far & ~large[side.labels], np.nan, factor)
    near = ~((factor > _FAR) | (factor < 1.0 / _FAR))
    factor = at_cells(np.where(near, 1.0, factor))
    return surface.albedo * factor


@dataclass(frozen=True, eq=False)
class _Areas:
    """Connected points: numbers from 1 on (R, C), 0 elsewhere; and the count of each."""

    labels: IntArray
    sizes: IntArray

    def largest(self) -> int:
        """Count of the points of the largest one."""
        return int(self.sizes.max(initial=0))


def _areas(points: BoolArray) -> _Areas:
    labels, _ = ndimage.label(points)
    return _Areas(labels, np.bincount(labels.ravel())[1:])


def _residuals(
    windows: Sequence[ImageWindow | None],
    surface: Surface,
    states: Sequence[ImageState],
    options: PhotoclinometryOptions,
) -> FloatArray:
    """Return the median relative residual (R, C) over the images; NaN of fewer than three."""
    known = np.ones(surface.height.shape, dtype=np.bool_)
    shown = [(one, state) for one, state in zip(windows, states, strict=True) if one is not None]
    # What most images leave over, most of some leave over, too.
    some = shown[:: -(-len(shown) // _ASKED) or 1]
    found = [compare_on_grid(window, surface, state, known, options) for window, state in some]
    residuals = [one.residual for one in found if one is not None]
    if len(residuals) < _IMAGES:
        return np.full(known.shape, np.nan)
    return _median(np.array(residuals))


def _median(residuals: FloatArray) -> FloatArray:
    """Return medians (R, C) of the known ones of K residuals (K, R, C); NaN with too few."""
    count = np.count_nonzero(np.isfinite(residuals), axis=0)
    middle = np.full(count.shape, np.nan)
    enough = count >= _IMAGES
    middle[enough] = np.nanmedian(residuals[:, enough], axis=0)
    return middle
