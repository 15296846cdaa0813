"""SPK and CK of nominal states."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import spiceypy

from spcola import atomic
from spcola.arrays import FloatArray
from spcola.navigation import SPICE_LOCK
from spcola.truth.kernels.names import BODY, BUS, CLOCK, SPACECRAFT
from spcola.truth.kernels.states import KernelState
from spcola.truth.kernels.texts import MOUNTS

_SUN = 10
_KM = 1e-3
_PAD_S = 30.0
# Half of the time around an image for which its attitude is stated, s.
_HALF_S = 0.5
_DEGREE = 3
_SEGMENT = "NOMINAL"
_SUN_KM = 1.65e8


def write_positions(path: Path, states: Sequence[KernelState], sun: FloatArray) -> None:
    """Write an SPK: spacecraft relative to the body, and the body relative to the Sun.

    Type 13 (cubic Hermite polynomials on unequal steps), one segment an arc, 30 s longer at either
    end. The Sun stands still.

    Parameters
    ----------
    path : Path
    states : sequence of KernelState
        In order of time.
    sun : (3,) ndarray
        Unit vector to the Sun in J2000.
    """
    whole = np.array([states[0].time - 10 * 86_400.0, states[-1].time + 10 * 86_400.0])
    place = np.concatenate([-_SUN_KM * sun, np.zeros(3)])
    comments = [
        "Nominal trajectory of a synthetic mission: navigation's, with its errors.",
        "Geometric positions; images are made without light time and aberration.",
        "The Sun stands still relative to the body.",
    ]
    with _new(path, spiceypy.spkopn, spiceypy.spkcls, comments) as handle:
        _segment(handle, (BODY, _SUN), whole, np.stack([place, place]))
        for arc in range(states[-1].arc + 1):
            inside = [state for state in states if state.arc == arc]
            times = np.array([state.time for state in inside])
            rows = _KM * np.array([[*state.position, *state.velocity] for state in inside])
            before, after = rows[0].copy(), rows[-1].copy()
            before[:3] -= _PAD_S * rows[0, 3:]
            after[:3] += _PAD_S * rows[-1, 3:]
            times = np.concatenate([[times[0] - _PAD_S], times, [times[-1] + _PAD_S]])
            _segment(handle, (SPACECRAFT, BODY), times, np.stack([before, *rows, after]))


def write_pointing(path: Path, states: Sequence[KernelState], clock: Path) -> None:
    """Write a CK of the spacecraft's attitude: constant for half a second around each image.

    Parameters
    ----------
    path : Path
    states : sequence of KernelState
        In order of time.
    clock : Path
        Clock kernel.
    """
    times = np.array([state.time for state in states])
    gaps = np.concatenate([[np.inf], np.diff(times), [np.inf]])
    half = np.minimum(_HALF_S, 0.4 * np.minimum(gaps[:-1], gaps[1:]))
    comments = ["Nominal attitude of a synthetic mission, at its images alone."]
    with SPICE_LOCK:
        spiceypy.furnsh(str(clock))
        try:
            turns = [spiceypy.m2q(MOUNTS[state.camera].T @ state.axes) for state in states]
            epochs = np.stack([times - half, times + half], axis=1).ravel()
            ticks = np.array([spiceypy.sce2c(CLOCK, float(epoch)) for epoch in epochs])
        finally:
            spiceypy.unload(str(clock))
    with _new(path, spiceypy.ckopn, spiceypy.ckcls, comments) as handle:
        spiceypy.ckw03(
            handle, ticks[0], ticks[-1], BUS, "J2000", False, _SEGMENT, len(ticks), ticks,
            np.repeat(np.array(turns), 2, axis=0), np.zeros((len(ticks), 3)), len(times),
            ticks[::2].copy(),
        )  # fmt: skip


def _segment(handle: int, ids: tuple[int, int], times: FloatArray, rows: FloatArray) -> None:
    """Write one segment of an SPK; `rows` (N, 6) in km and km/s."""
    ends = (float(times[0]), float(times[-1]))
    spiceypy.spkw13(handle, *ids, "J2000", *ends, _SEGMENT, _DEGREE, len(times), rows, times)


@contextmanager
def _new(
    path: Path,
    begin: Callable[[str, str, int], int],
    end: Callable[[int], None],
    comments: Sequence[str],
) -> Iterator[int]:
    """Yield the handle of a new kernel, which is written whole or not at all."""
    with atomic.replacing(path) as temporary, SPICE_LOCK:
        temporary.unlink(missing_ok=True)
        handle = begin(str(temporary), _SEGMENT, sum(len(line) + 1 for line in comments))
        try:
            spiceypy.dafac(handle, list(comments))
            yield handle
        except BaseException:
            spiceypy.dafcls(handle)
            raise
        end(handle)
