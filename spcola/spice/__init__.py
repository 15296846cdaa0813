"""SPICE kernels: states, pointing, coverage, and checks of the rotation."""

from spcola.spice.coverage_windows import Coverage, Track
from spcola.spice.kernels import POINTING_TOLERANCE_S, KernelSet, body_fixed_states, coverage
from spcola.spice.pck import constant, orientation_of
from spcola.spice.rotation_check import KernelUse
from spcola.spice.transfer import read_transfer

__all__ = [
    "POINTING_TOLERANCE_S",
    "Coverage",
    "KernelSet",
    "KernelUse",
    "Track",
    "body_fixed_states",
    "constant",
    "coverage",
    "orientation_of",
    "read_transfer",
]
