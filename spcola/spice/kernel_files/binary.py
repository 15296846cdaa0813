"""Segments of SPK and CK."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import spiceypy

from spcola import atomic
from spcola.arrays import FloatArray
from spcola.navigation import SPICE_LOCK
from spcola.spice.kernels import kernel_errors

_DEGREE = 3


@contextmanager
def _new_kernel(
    begin: Callable[[str, str, int], int],
    end: Callable[[int], None],
    path: Path,
    name: str,
    comments: Sequence[str],
) -> Iterator[int]:
    """Yield the handle of a new kernel, which is written whole or not at all.

    Raises
    ------
    KernelError
        If SPICE refuses what is written.
    """
    with atomic.replacing(path) as temporary, SPICE_LOCK, kernel_errors(path):
        temporary.unlink(missing_ok=True)
        handle = begin(str(temporary), name, sum(len(line) + 1 for line in comments) + 1)
        try:
            spiceypy.dafac(handle, list(comments))
            yield handle
        except BaseException:
            # A kernel without a whole segment cannot be closed as one.
            spiceypy.dafcls(handle)
            raise
        end(handle)


new_spk = partial(_new_kernel, spiceypy.spkopn, spiceypy.spkcls)
"""Context of a new SPK, of its path, name and comments: yields a handle."""
new_ck = partial(_new_kernel, spiceypy.ckopn, spiceypy.ckcls)
"""Context of a new CK, of its path, name and comments: yields a handle."""


def spk_of_arc(
    handle: int,
    name: str,
    ids: tuple[int, int],
    times: FloatArray,
    states: FloatArray,
    *,
    pad_s: float = 0.0,
) -> None:
    """Write one segment of an SPK, of type 13: cubic Hermite polynomials on unequal steps.

    Parameters
    ----------
    handle : int
    name : str
    ids : (int, int)
        NAIF numbers of the target and the centre.
    times : (N,) ndarray
        Ephemeris times, s, increasing.
    states : (N, 6) ndarray
        Of the target relative to the centre along J2000, km and km/s.
    pad_s : float
        The segment is longer by this at either end, on a straight line.
    """
    if pad_s > 0.0:
        times, places, velocity = _padded(times, states[:, :3], states[:, 3:], pad_s)
        states = np.concatenate([places, velocity], axis=1)
    ends = (float(times[0]), float(times[-1]))
    spiceypy.spkw13(handle, *ids, "J2000", *ends, name, _DEGREE, len(times), states, times)


def ck_of_attitudes(
    handle: int,
    name: str,
    ids: tuple[int, int],
    times: FloatArray,
    axes: FloatArray,
    *,
    most_s: float,
) -> None:
    """Write one segment of a CK, of type 3: constant around each time, unknown between them.

    Rates are not stated.

    Parameters
    ----------
    handle : int
    name : str
    ids : (int, int)
        Numbers of the frame, and of the clock, whose kernel is loaded.
    times : (N,) ndarray
        Ephemeris times, s, increasing.
    axes : (N, 3, 3) ndarray
        Rows: axes along J2000.
    most_s : float
        Each attitude holds up to this long before and after its time, seconds.
    """
    frame, clock = ids
    half = _half_widths(times, most_s)
    epochs = np.stack([times - half, times + half], axis=1).ravel()
    ticks = np.array([spiceypy.sce2c(clock, float(epoch)) for epoch in epochs])
    turns = np.repeat(np.array([spiceypy.m2q(rows) for rows in axes]), 2, axis=0)
    spiceypy.ckw03(
        handle, ticks[0], ticks[-1], frame, "J2000", False, name, len(ticks), ticks,
        turns, np.zeros((len(ticks), 3)), len(times), ticks[::2].copy(),
    )  # fmt: skip


def _padded(
    times: FloatArray, places: FloatArray, velocity: FloatArray, pad_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return an arc with one more state `pad_s` seconds before and after it, on a straight line."""
    return (
        np.concatenate([[times[0] - pad_s], times, [times[-1] + pad_s]]),
        np.concatenate(
            [[places[0] - pad_s * velocity[0]], places, [places[-1] + pad_s * velocity[-1]]]
        ),
        np.concatenate([velocity[:1], velocity, velocity[-1:]]),
    )


def _half_widths(times: FloatArray, most_s: float) -> FloatArray:
    """Return half of the interval (N,), s, around each time that touches no other's."""
    steps = np.diff(times)
    near = np.minimum(np.append(steps, np.inf), np.append(np.inf, steps))
    return np.minimum(most_s, 0.4 * near)
