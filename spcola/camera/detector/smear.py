r"""Smear of a frame-transfer detector without a shutter.

The detector is lit while the frame is moved, line by line, into the covered memory. The charge of
line :math:`l` rests for :math:`t_2` on each line between it and the memory, so that

.. math:: D_l = S_l + \frac{t_2}{t} \sum_{k<l} S_k + \frac{t_0}{t} \sum_{k>l} S_k

:math:`D` is the brightness without dark level, :math:`S` the brightness without smear, :math:`t`
the exposure time; lines are counted from the memory. The first sum is the frame transfer smear of
Murchie et al. (1999, Icarus 140, 66, NEAR MSI) and of MESSENGER's MDIS (Hawkins et al. 2007); the
second is of detectors whose frame is cleared by the same transfer, :math:`t_0` a line, just before
the exposure.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera.detector.pixels import PixelValues
from spcola.errors import InvalidValueError

MemorySide = Literal["first line", "last line"]


@dataclass(frozen=True)
class FrameTransfer:
    """Times of a frame transfer.

    Parameters
    ----------
    exposure_s : float
        Exposure time t.
    line_transfer_s : float
        Time t₂ for one line; NEAR MSI: 0.9 ms / lines, MDIS: 3.84 ms / 1024.
    clearing_s : float
        Time t₀ for one line of the transfer that clears the frame before the exposure; 0 if it is
        cleared in another way.
    memory_side : {"first line", "last line"}
        Edge of the image (as stored) at which the frame goes into the memory.

    Raises
    ------
    InvalidValueError
        If a time is impossible, or smear would exceed the exposure.
    """

    exposure_s: float
    line_transfer_s: float
    clearing_s: float = 0.0
    memory_side: MemorySide = "first line"

    def __post_init__(self) -> None:
        times = (self.exposure_s, self.line_transfer_s, self.clearing_s)
        if not (all(np.isfinite(times)) and self.exposure_s > 0 and min(times) >= 0):
            raise InvalidValueError(
                f"has times of {times} s, positive ones are needed", "frame transfer"
            )
        if max(self.line_transfer_s, self.clearing_s) >= self.exposure_s:
            raise InvalidValueError(
                f"takes {max(times[1:]):g} s a line, the exposure {self.exposure_s:g} s",
                "frame transfer",
                "are both in seconds?",
            )
        if self.memory_side not in ("first line", "last line"):
            raise InvalidValueError(f"is {self.memory_side!r}", "memory side")


@dataclass(frozen=True)
class SmearTimes:
    """Times of the frame transfer of all images of a camera; see :class:`FrameTransfer`.

    Parameters
    ----------
    line_transfer_s, clearing_s : float
        For one line.
    memory_side : {"first line", "last line"}
        Edge of the image, as stored, at which the frame goes into the memory.
    exposure_s : float, optional
        Exposure time of all images; that of each label if not given.

    Raises
    ------
    InvalidValueError
        If a time is negative or not finite.
    """

    line_transfer_s: float
    clearing_s: float = 0.0
    memory_side: MemorySide = "first line"
    exposure_s: float | None = None

    def __post_init__(self) -> None:
        # Checked at the longest exposure: that of an image is named with the image.
        self.transfer(float(np.finfo(float).max))

    def transfer(self, exposure_s: float) -> FrameTransfer:
        """Return the frame transfer at an exposure time.

        Parameters
        ----------
        exposure_s : float
            Seconds.

        Raises
        ------
        InvalidValueError
            If it is shorter than the transfer of a line.
        """
        return FrameTransfer(exposure_s, self.line_transfer_s, self.clearing_s, self.memory_side)


def remove_smear(pixels: PixelValues, transfer: FrameTransfer) -> PixelValues:
    """Return the pixels without smear: the solution S of the equations above, exact to rounding.

    A pixel without a measurement smears like the last measured one before it in its column (like
    0 if there is none); a saturated one was brighter than that, so that lines behind it keep
    some smear.

    Parameters
    ----------
    pixels : PixelValues
        Brightness without dark level, all lines of the lit part of the detector.
    transfer : FrameTransfer
    """
    from_memory = slice(None, None, 1 if transfer.memory_side == "first line" else -1)
    observed = _without_gaps(pixels)[from_memory]
    a = transfer.line_transfer_s / transfer.exposure_s
    b = transfer.clearing_s / transfer.exposure_s
    clear = np.empty_like(observed)
    clear[from_memory] = _solve(observed, a, b)
    return pixels.with_values(np.where(pixels.valid, clear, np.nan))


def _solve(observed: FloatArray, a: float, b: float) -> FloatArray:
    """Return S (lines, samples) of D, lines from the memory.

    The difference of two lines' equations is S(l+1) (1 − b) = D(l+1) − D(l) + S(l) (1 − a). So
    each S is p + q S(0), and the first equation gives S(0).
    """
    lines = len(observed)
    p = np.zeros_like(observed)
    q = ((1 - a) / (1 - b)) ** np.arange(lines)
    for line in range(1, lines):
        rise = observed[line] - observed[line - 1]
        p[line] = (rise + (1 - a) * p[line - 1]) / (1 - b)
    first = (observed[0] - b * p[1:].sum(axis=0)) / (1 + b * q[1:].sum())
    return p + q[:, None] * first


def _without_gaps(pixels: PixelValues) -> FloatArray:
    """Return float64 values; gaps have the last measured value before them in the column."""
    values = pixels.values.astype(np.float64)
    valid = pixels.valid & np.isfinite(values)
    if np.all(valid):
        return values
    line = np.where(valid, np.arange(len(values))[:, None], -1)
    last = np.maximum.accumulate(line, axis=0)
    filled = np.take_along_axis(values, np.maximum(last, 0), axis=0)
    return np.where(last >= 0, filled, 0.0)
