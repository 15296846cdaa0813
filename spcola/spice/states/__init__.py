"""States of images from SPICE kernels."""

from spcola.spice.states.reading import (
    Correction,
    SpiceCamera,
    body_rate,
    clock_time,
    spice_states,
)
from spcola.spice.states.rotation import spin_of

__all__ = [
    "Correction",
    "SpiceCamera",
    "body_rate",
    "clock_time",
    "spice_states",
    "spin_of",
]
