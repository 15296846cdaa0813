"""Kernels for tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import spiceypy

from spcola.navigation import SPICE_LOCK
from spcola.spice.daf import daf_segments, state_epochs


def spk(path: Path, times: np.ndarray, states_km: np.ndarray, body: int = 2101955) -> Path:
    """An SPK of spacecraft -999 relative to a body: states (N, 6), km and km/s, along J2000."""
    with SPICE_LOCK:
        handle = spiceypy.spkopn(str(path), "TEST", 0)
        spiceypy.spkw09(
            handle, -999, body, "J2000", times[0], times[-1], "S", 1, len(times), states_km, times
        )
        spiceypy.spkcls(handle)
    return path


def image_times(path: Path) -> np.ndarray:
    """Times of the states in an SPK that was made from images."""
    return np.concatenate([state_epochs(one.values, path) for one in daf_segments(path)])
