"""SPICE kernels: states, pointing, coverage, and checks of the rotation."""

from spcola.spice.coverage_windows import KernelCoverage
from spcola.spice.kernels import POINTING_TOLERANCE_S, KernelSet, body_fixed_states, coverage
from spcola.spice.pck import orientation_of
from spcola.spice.rotation_check import KernelUse
from spcola.spice.text_kernel import expand_meta_kernels
from spcola.spice.transfer import read_transfer

__all__ = [
    "POINTING_TOLERANCE_S",
    "KernelCoverage",
    "KernelSet",
    "KernelUse",
    "body_fixed_states",
    "coverage",
    "expand_meta_kernels",
    "orientation_of",
    "read_transfer",
]
