"""Kernels of a synthetic mission: SPK, CK, PCK, IK, frames, clock, leap seconds."""

from spcola.truth.kernels.binary import write_pointing, write_positions
from spcola.truth.kernels.states import KernelState, inertial_sun, nominal_states, true_spin
from spcola.truth.kernels.texts import MissionClock, write_texts

__all__ = [
    "KernelState",
    "MissionClock",
    "inertial_sun",
    "nominal_states",
    "true_spin",
    "write_pointing",
    "write_positions",
    "write_texts",
]
