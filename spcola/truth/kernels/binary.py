"""SPK and CK of nominal states."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from spcola.arrays import FloatArray
from spcola.spice import KernelSet
from spcola.spice.kernel_files import ck_of_attitudes, new_ck, new_spk, spk_of_arc
from spcola.truth.kernels.names import BODY, BUS, CLOCK, SPACECRAFT
from spcola.truth.kernels.states import KernelState
from spcola.truth.kernels.texts import MOUNTS

_SUN = 10
_KM = 1e-3
_PAD_S = 30.0
# Half of the time around an image for which its attitude is stated, s.
_HALF_S = 0.5
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
    with new_spk(path, _SEGMENT, comments) as handle:
        spk_of_arc(handle, _SEGMENT, (BODY, _SUN), whole, np.stack([place, place]))
        for arc in range(states[-1].arc + 1):
            inside = [state for state in states if state.arc == arc]
            times = np.array([state.time for state in inside])
            rows = _KM * np.array([[*state.position, *state.velocity] for state in inside])
            spk_of_arc(handle, _SEGMENT, (SPACECRAFT, BODY), times, rows, pad_s=_PAD_S)


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
    axes = np.array([MOUNTS[state.camera].T @ state.axes for state in states])
    comments = ["Nominal attitude of a synthetic mission, at its images alone."]
    with KernelSet(clock).load(), new_ck(path, _SEGMENT, comments) as handle:
        ck_of_attitudes(handle, _SEGMENT, (BUS, CLOCK), times, axes, most_s=_HALF_S)
