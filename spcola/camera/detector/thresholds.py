"""Thresholds of an image: darkest and brightest brightness that is used (THRSH of a .SUM file)."""

from __future__ import annotations

import numpy as np

from spcola.arrays import AnyArray, FloatArray
from spcola.camera.detector.bit_depth import StoredPixels
from spcola.errors import InvalidValueError, NotObservableError

# Lit ground: the 99th percentile. Sky and shadow: below a quarter of it.
_LIT = 99.0
_DARK_SHARE = 0.25
# Standard deviations of the dark pixels above their peak that the threshold lies.
_SIGMAS = 5.0
# Without a dark peak: this share of lit ground.
_FLOOR = 0.02
# A valley is at most half as high as the peaks that it separates.
_VALLEY = 0.5
_NOISE = 3.0
_FEWEST = 0.001


def shadow_threshold(stored: StoredPixels) -> int:
    """Return the lowest DN of lit ground, from the histogram.

    The dark pixels are those below a quarter of the 99th percentile. If their histogram has a peak
    (at least 0.1 % of all pixels) and above it a valley half as high, beyond the noise of both
    counts (three standard deviations), the threshold is the peak plus five standard deviations,
    at most that quarter; the standard deviation is that of the pixels below the peak, mirrored:
    nothing but noise is darker than the dark. Otherwise the body fills the frame without
    shadows, and the threshold is 2 % of the 99th percentile. It is at least 1: DN 0 stands for
    missing pixels.

    Raises
    ------
    NotObservableError
        If no pixel is between 0 and the largest DN.
    """
    counts = _histogram(stored)
    lit = _percentile(counts, _LIT)
    cap = max(int(np.ceil(_DARK_SHARE * lit)), 1)
    floor = max(int(np.ceil(_FLOOR * lit)), 1)
    smooth = _smoothed(counts, cap)
    peak = int(np.argmax(smooth[:cap])) if cap > 1 else 0
    few = counts[:cap].sum() < _FEWEST * counts.sum()
    if few or not _is_valley(smooth[peak:cap].min(), smooth[peak]):
        return min(floor, cap)
    levels = np.arange(peak + 1)
    below = counts[: peak + 1]
    spread = np.sqrt(np.sum(below * (levels - peak) ** 2.0) / max(below.sum(), 1.0))
    return int(min(max(peak + int(np.ceil(_SIGMAS * spread)), peak + 1, 1), cap))


def bright_threshold(stored: StoredPixels, lowest: int) -> int:
    """Return the highest DN of the body in front of a brighter background, from the histogram.

    The lit pixels are separated into two classes by Otsu's rule (largest variance between the
    classes), and the threshold is the lowest point of the histogram between their peaks.

    Parameters
    ----------
    stored : StoredPixels
    lowest : int
        Threshold of shadow: darker pixels are left out.

    Raises
    ------
    NotObservableError
        If the histogram has no valley half as high as both peaks: no bright background.
    """
    counts = _histogram(stored)
    counts[:lowest] = 0.0
    if not counts.any():
        raise NotObservableError("has no lit pixel", where="bright background")
    split = _otsu(counts)
    smooth = _smoothed(counts, _percentile(counts, _LIT))
    low_peak = int(np.argmax(smooth[: split + 1]))
    high_peak = split + 1 + int(np.argmax(smooth[split + 1 :]))
    valley = low_peak + int(np.argmin(smooth[low_peak : high_peak + 1]))
    if not _is_valley(smooth[valley], min(smooth[low_peak], smooth[high_peak])):
        raise NotObservableError(
            "cannot be separated from the body: the histogram has no valley",
            where="bright background",
            do="give the upper threshold",
        )
    return valley


def check_thresholds(low: int, high: int, largest: int) -> tuple[int, int]:
    """Return thresholds if they are in order and in range.

    Raises
    ------
    InvalidValueError
        If they are not.
    """
    if not 0 <= low < high <= largest:
        raise InvalidValueError(
            f"are {low} and {high}, two rising numbers up to {largest} are needed", "thresholds"
        )
    return low, high


def _histogram(stored: StoredPixels) -> FloatArray:
    """Return counts of all DN; those of missing and saturated pixels are 0."""
    size = stored.depth.largest + 1
    counts = np.bincount(stored.dn.ravel(), minlength=size).astype(np.float64)
    counts[0] = max(counts[0] - stored.missing, 0.0)
    counts[-1] = max(counts[-1] - stored.saturated, 0.0)
    if not counts[:-1].any():
        raise NotObservableError("has no pixel below saturation", where="histogram")
    return counts


def _percentile(counts: AnyArray, percent: float) -> int:
    """Return the DN at a percentile of a histogram."""
    total = np.cumsum(counts)
    return int(np.searchsorted(total, percent / 100.0 * total[-1]))


def _smoothed(counts: FloatArray, scale: int) -> FloatArray:
    """Return counts in windows of 1/64 of `scale`: gaps between scaled integers close."""
    half = scale // 128
    total = np.concatenate([[0.0], np.cumsum(counts)])
    levels = np.arange(len(counts))
    last = np.minimum(levels + half + 1, len(counts))
    smooth: FloatArray = total[last] - total[np.maximum(levels - half, 0)]
    return smooth


def _is_valley(valley: float, peak: float) -> bool:
    """Return whether a count is less than half of another one, beyond the noise of both."""
    highest, lowest = (n + sign * _NOISE * np.sqrt(n) for n, sign in ((valley, 1), (peak, -1)))
    return bool(highest < _VALLEY * lowest)


def _otsu(counts: FloatArray) -> int:
    """Return the last DN of the darker class (Otsu 1979)."""
    levels = np.arange(len(counts))
    weight = np.cumsum(counts)
    moment = np.cumsum(counts * levels)
    rest = weight[-1] - weight
    inside = (weight > 0) & (rest > 0)
    if not inside.any():
        return int(np.argmax(counts))
    difference = np.zeros(len(counts))
    difference[inside] = (moment[-1] * weight[inside] / weight[-1] - moment[inside]) ** 2 / (
        weight[inside] * rest[inside]
    )
    return int(np.argmax(difference))
