"""Images and maplets that fit far worse than the others, and what to do with them."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from spcola.math.robust import mad
from spcola.photometry.photoclinometry import Fit, ImageFit

# Robust standard deviations of the logarithms, and the factor on the median, beyond which one is
# far from the others.
_FAR, _FACTOR = 4.0, 2.0
# Fewest values of which a scatter is known. Of fewer residuals, one that is this many times their
# median is far from the others; so may be a shift by chance.
_FEWEST, _FEW_FACTOR = 8, 3.0
# Fewest of the others with which one is compared, such as the images of a maplet.
_COMPANY = 3
# An image shows other relief than the others if its residual is so many times the median of its
# maplets, it correlates less than this, and as many of its pixels count. Of right images of seven
# bodies of `mini`, `bennu` and 67P one that passes the first two has 620 pixels at most.
_UNLIKE_FACTOR, _ALIKE, _UNLIKE_PIXELS = 4.0, 0.6, 800
# A shift below, pixels, is no outlier: images are matched no better than to a tenth of a pixel.
_LEAST_SHIFT = 0.3

_WHAT_TO_DO = {
    "image-residual": "more of them is left over than of others on the same maplets, compared with "
    "their noise or in relief: look at their residuals in report or page; check pixels, thresholds "
    "and date, or leave them out; where pixels are finer than the grid, a finer GSD: "
    "spcola spc tile",
    "image-shift": "they lie far from where their states put them, more than the others: make "
    "their states anew: spcola sumfiles",
    "maplet-residual": "more is left over of their images than elsewhere: look at the residuals in "
    "report or page; where bright areas are left over, "
    '[lithos] albedo_mean = "0.5" if it is not set; where relief is, a finer GSD: spcola spc tile',
    "maplet-shift": "their images see them far from where they are, more than others: start from "
    "the shape: --start shape",
}


def outlier_findings(found: Mapping[str, Sequence[ImageFit]]) -> list[dict[str, Any]]:
    """Return those far from the others by code: `code`, `names`, `do`.

    A residual, over the noise of its image, is compared with the median of all images of its
    maplet, or of all maplets of its image, before medians are taken: an image is not blamed for the
    maplets that it happens to show, nor for noise, which the weights contain.

    Parameters
    ----------
    found : mapping of str to sequence of ImageFit
        Fits of the images by the name of a solved maplet.
    """
    fits = {
        (maplet, fit.name): fit
        for maplet, images in found.items()
        for fit in images
        if fit.fit is Fit.USED
    }
    ratios = {pair: fit.residual / fit.noise for pair, fit in fits.items() if fit.noise > 0.0}
    shifts = {pair: float(np.hypot(*fit.shift_px)) for pair, fit in fits.items()}
    far = _far(_compared(ratios, by=1), few=_FEW_FACTOR)
    named = {
        "image-residual": [*far, *(name for name in _unlike(fits) if name not in far)],
        "image-shift": _far(_medians(shifts, by=1), _LEAST_SHIFT),
        "maplet-residual": _far(_compared(ratios, by=0), few=_FEW_FACTOR),
        "maplet-shift": _far(_medians(shifts, by=0), _LEAST_SHIFT),
    }
    return [
        {"code": code, "names": names, "do": _WHAT_TO_DO[code]}
        for code, names in named.items()
        if names
    ]


_Pairs = Mapping[tuple[str, str], float]


def _unlike(fits: Mapping[tuple[str, str], ImageFit]) -> list[str]:
    """Return the images whose relief is not that of the others, as of another date's boulders.

    The noise of an image contains relief that the surface lacks, so that it hides such images.
    """
    residuals = _compared({pair: fit.residual for pair, fit in fits.items()}, by=1)
    alike = _medians({pair: fit.correlation for pair, fit in fits.items()}, by=1)
    pixels = Counter[str]()
    for (_, image), fit in fits.items():
        pixels[image] += fit.pixels
    return [
        name
        for name, ratio in sorted(residuals.items())
        if ratio > _UNLIKE_FACTOR and alike[name] < _ALIKE and pixels[name] >= _UNLIKE_PIXELS
    ]


def _compared(values: _Pairs, by: int) -> dict[str, float]:
    """Return medians by maplet (0) or image (1) of values over the medians of the other kind."""
    others = _groups(values, 1 - by)
    usual = {name: float(np.median(ones)) for name, ones in others.items() if len(ones) >= _COMPANY}
    pairs = {
        pair: value / usual[pair[1 - by]] for pair, value in values.items() if pair[1 - by] in usual
    }
    return _medians(pairs, by)


def _medians(values: _Pairs, by: int) -> dict[str, float]:
    return {name: float(np.median(ones)) for name, ones in _groups(values, by).items()}


def _groups(values: _Pairs, by: int) -> dict[str, list[float]]:
    groups = defaultdict(list)
    for pair, value in values.items():
        groups[pair[by]].append(value)
    return groups


def _far(values: Mapping[str, float], least: float = 0.0, few: float = np.inf) -> list[str]:
    """Return the names whose value is far above the others, the largest first.

    Values up to `least` are not; `few` is the factor on the median of few values.
    """
    if len(values) <= _COMPANY:
        return []
    logs = _logs(values.values())
    if len(values) < _FEWEST:
        above = float(np.log(few))
    else:
        above = max(_FAR * float(mad(logs)), float(np.log(_FACTOR)))
    limit = float(np.median(logs)) + above
    far = [name for name, value in values.items() if value > max(least, float(np.exp(limit)))]
    return sorted(far, key=lambda name: (-values[name], name))


def _logs(values: Iterable[float]) -> Any:
    return np.log(np.maximum(list(values), 1e-12))
