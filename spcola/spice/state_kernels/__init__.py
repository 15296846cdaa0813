"""SPICE kernels from the states of a solution."""

from spcola.spice.state_kernels.exporting import META_KERNEL, StateKernels, write_state_kernels
from spcola.spice.state_kernels.text import KernelNumbers

__all__ = ["META_KERNEL", "KernelNumbers", "StateKernels", "write_state_kernels"]
