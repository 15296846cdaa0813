"""Areas whose brightness most images leave over: an albedo, or relief, that priors forbid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from spcola.arrays import FloatArray
from spcola.photometry.photoclinometry.comparison import compare_on_grid
from spcola.photometry.photoclinometry.image_equations import ImageState
from spcola.photometry.photoclinometry.image_window import ImageWindow
from spcola.photometry.photoclinometry.options import PhotoclinometryOptions
from spcola.photometry.photoclinometry.surface import Surface

# Relative residual, median over the images that show a point, beyond which it is left over; fewest
# of these, and fewest connected points of an area. Relief that the grid does not resolve leaves 8
# points at most on `mini` and 11 on `bennu`; an area of 113 points of three times the albedo 125.
_LEFT, _IMAGES, _POINTS = 0.2, 3, 25
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
    known = np.ones(surface.height.shape, dtype=np.bool_)
    shown = [(one, state) for one, state in zip(windows, states, strict=True) if one is not None]
    # What most images leave over, most of some leave over, too.
    some = shown[:: -(-len(shown) // _ASKED) or 1]
    found = [compare_on_grid(window, surface, state, known, options) for window, state in some]
    residuals = [one.residual for one in found if one is not None]
    if len(residuals) < _IMAGES:
        return float("nan")
    middle = _median(np.array(residuals))
    largest, area = 0, np.zeros(middle.shape, dtype=np.bool_)
    for side in (middle > _LEFT, middle < -_LEFT):
        labels, _ = ndimage.label(side)
        sizes = np.bincount(labels.ravel())[1:]
        if sizes.size and sizes.max() > largest:
            largest, area = int(sizes.max()), labels == 1 + int(sizes.argmax())
    return float(np.median(middle[area])) if largest >= _POINTS else float("nan")


def _median(residuals: FloatArray) -> FloatArray:
    """Return medians (R, C) of the known ones of K residuals (K, R, C); NaN with too few."""
    count = np.count_nonzero(np.isfinite(residuals), axis=0)
    middle = np.full(count.shape, np.nan)
    enough = count >= _IMAGES
    middle[enough] = np.nanmedian(residuals[:, enough], axis=0)
    return middle
