"""States of images from SPICE kernels, and kernels from the states of a solution."""

from spcola.spice.states.exporting import META_KERNEL, StateKernels, write_state_kernels
from spcola.spice.states.reading import Correction, SpiceCamera, body_rate, clock_time, spice_states
from spcola.spice.states.rotation import spin_of
from spcola.spice.states.text import Numbers

__all__ = [
    "META_KERNEL",
    "Correction",
    "Numbers",
    "SpiceCamera",
    "StateKernels",
    "body_rate",
    "clock_time",
    "spice_states",
    "spin_of",
    "write_state_kernels",
]
