"""SPK and CK of the states of images, with comments that state where they come from."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import spiceypy

from spcola.arrays import FloatArray
from spcola.navigation import SPICE_LOCK
from spcola.spice.kernels import M_PER_KM, kernel_errors
from spcola.spice.state_kernels.arcs import arcs, half_widths, padded, rates

PAD_S = 0.5
"""States are covered this long before and after the middle of an exposure, seconds."""

_DEGREE = 3
_SEGMENT = "SPC STATES OF IMAGES"


def write_spk(
    path: Path,
    ids: tuple[int, int],
    times: FloatArray,
    places: FloatArray,
    *,
    max_gap_s: float,
    comments: Sequence[str],
) -> int:
    """Write positions as an SPK of type 13: cubic Hermite polynomials on unequal steps.

    Velocities are differences of neighbouring positions. Each arc is one segment. It begins and
    ends half a second beyond its images; a single image has zero velocity.

    Parameters
    ----------
    path : Path
        A new file.
    ids : (int, int)
        NAIF numbers of the target and the centre.
    times : (N,) ndarray
        Ephemeris times, s, increasing.
    places : (N, 3) ndarray
        Of the target relative to the centre along J2000, metres.
    max_gap_s : float
        Positions further apart, s, are not interpolated between.
    comments : sequence of str

    Returns
    -------
    int
        Number of segments.

    Raises
    ------
    KernelError
        If SPICE refuses the states.
    """
    parts = arcs(times, max_gap_s)
    with SPICE_LOCK, kernel_errors(path):
        handle = spiceypy.spkopn(str(path), _SEGMENT, _length(comments))
        with _closing(handle, comments, spiceypy.spkcls):
            for part in parts:
                velocity = rates(times[part], places[part])
                epochs, position, speed = padded(times[part], places[part], velocity, PAD_S)
                states = np.concatenate([position, speed], axis=1) / M_PER_KM
                ends = (float(epochs[0]), float(epochs[-1]))
                spiceypy.spkw13(
                    handle, *ids, "J2000", *ends, _SEGMENT, _DEGREE, len(epochs), states, epochs
                )  # fmt: skip
    return len(parts)


def write_ck(
    path: Path,
    clock: int,
    tracks: Sequence[tuple[int, FloatArray, FloatArray]],
    *,
    comments: Sequence[str],
) -> None:
    """Write attitudes as a CK of type 3, constant around each image and unknown between images.

    Each image is one interval of interpolation, of up to half a second before and after it, with
    one attitude. Rates are not stated.

    Parameters
    ----------
    path : Path
        A new file.
    clock : int
        Number of the clock, whose kernel is loaded.
    tracks : sequence of (int, (N,) ndarray, (N, 3, 3) ndarray)
        For each instrument: its number, ephemeris times, s, increasing, and axes along J2000.
    comments : sequence of str

    Raises
    ------
    KernelError
        If SPICE refuses the attitudes.
    """
    with SPICE_LOCK, kernel_errors(path):
        handle = spiceypy.ckopn(str(path), _SEGMENT, _length(comments))
        with _closing(handle, comments, spiceypy.ckcls):
            for instrument, times, axes in tracks:
                half = half_widths(times, PAD_S)
                epochs = np.stack([times - half, times + half], axis=1).ravel()
                ticks = np.array([spiceypy.sce2c(clock, float(epoch)) for epoch in epochs])
                turned = np.array([spiceypy.m2q(rows) for rows in axes])
                spiceypy.ckw03(
                    handle,
                    ticks[0],
                    ticks[-1],
                    instrument,
                    "J2000",
                    False,
                    _SEGMENT,
                    len(ticks),
                    ticks,
                    np.repeat(turned, 2, axis=0),
                    np.zeros((len(ticks), 3)),
                    len(times),
                    ticks[::2].copy(),
                )


def _length(comments: Sequence[str]) -> int:
    """Return the space for comments, characters."""
    return sum(len(line) + 1 for line in comments) + 1


@contextmanager
def _closing(handle: int, comments: Sequence[str], close: Callable[[int], None]) -> Iterator[None]:
    """Write comments, and close the kernel when its segments are complete."""
    spiceypy.dafac(handle, list(comments))
    try:
        yield
    except BaseException:
        # A kernel without a whole segment cannot be closed as one.
        spiceypy.dafcls(handle)
        raise
    close(handle)
