"""How many bytes a pixel of a .DAT file has, by its content."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from spcola.arrays import AnyArray, FloatArray
from spcola.formats.text.source import regular_size

__all__ = ["bytes_by_content"]

# Lines that are looked at, evenly chosen.
_LINES = 64
# Bytes at even and at odd places of the lines. In images of one byte a pixel they are neighbours,
# and correlate at least as much as every second byte does (real frames: by 0.01 more; noise alone:
# the same). In images of two bytes one of them is the finer part: it correlates with the other by
# 0.09 to 1.1 less than the coarse parts with each other (4000 synthetic and real images).
_LESS, _AS_MUCH, _LEAST = 0.1, 0.03, 0.3
# The two have the same mean and standard deviation in images of one byte: difference of both over
# the standard deviation.
_ALIKE = 0.1
# Where one of both never varies: share of the other that does, above which it is no hot pixels.
_VARIES = 0.1
# Eight bits that were multiplied have both bytes alike, and no more values than this.
_VALUES = 256


def bytes_by_content(path: str | Path, width: int, height: int) -> int:
    """Return how many bytes a pixel of a .DAT file seems to have: 1 or 2; 0 where it is not clear.

    Its length fits one or two bytes a pixel, and is taken as such. With NPX and NLN of another
    image that may be wrong: half of a file of 16 bits has the length of one of 8 bits, and 8 bits
    of twice as many pixels that of 16 bits.

    Parameters
    ----------
    path : str or Path
        Of which some lines are read.
    width, height : int
        NPX and NLN.

    Raises
    ------
    OSError
        If the file cannot be read.
    """
    length = regular_size(path)
    if not length or length % (width * height):
        return 0
    content: AnyArray = np.memmap(path, np.uint8, mode="r").reshape(height, -1)
    lines = np.unique(np.linspace(0, height - 1, _LINES).astype(int))
    if content.shape[1] % 2:
        # Every second line starts with the second byte of a pair.
        lines = lines[lines % 2 == 0]
    pairs = content[lines, : content.shape[1] // 2 * 2].reshape(lines.size, -1, 2)
    if pairs.shape[1] < 2:
        return 0
    return _bytes_of(pairs[..., 0], pairs[..., 1])


def _bytes_of(even: AnyArray, odd: AnyArray) -> int:
    """Return 1, 2 or 0 by bytes (K, N) at even and at odd places of lines."""
    spread = np.array([np.std(one) for one in (even, odd)])
    if not spread.all():
        other = odd if spread[1] else even
        varies = np.mean(other != np.median(other)) > _VARIES
        return 2 if spread.any() and varies else 0
    across = _correlation(even, odd)
    along = [_correlation(one[:, 1:], one[:, :-1]) for one in (even, odd)]
    far = abs(np.mean(even) - np.mean(odd)) + abs(spread[0] - spread[1])
    alike = bool(far < _ALIKE * spread.min())
    if not alike and across < max(along) - _LESS:
        return 2
    values = np.unique(even.astype(np.uint16) << 8 | odd).size
    same = across > max(_LEAST, max(along) - _AS_MUCH)
    return 1 if alike and same and values > _VALUES else 0


def _correlation(one: AnyArray, other: AnyArray) -> float:
    """Return the correlation of two arrays; −1 where one is uniform."""
    a: FloatArray = one - np.mean(one)
    b: FloatArray = other - np.mean(other)
    scale = float(np.sqrt(np.sum(a * a) * np.sum(b * b)))
    return float(np.sum(a * b)) / scale if scale > 0.0 else -1.0
