"""Writing of SPICE kernels: SPK and CK of states, and text kernels."""

from spcola.spice.kernel_files.binary import ck_of_attitudes, new_ck, new_spk, spk_of_arc
from spcola.spice.kernel_files.text import (
    clock_items,
    frame_items,
    kernel_text,
    meta_kernel_text,
    rotation_items,
)

__all__ = [
    "ck_of_attitudes",
    "clock_items",
    "frame_items",
    "kernel_text",
    "meta_kernel_text",
    "new_ck",
    "new_spk",
    "rotation_items",
    "spk_of_arc",
]
