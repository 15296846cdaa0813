"""Compilation of numerical functions (Numba), its cache, and bands of rows for threads."""

from spcola.compilation.bands import Bands, usable_threads
from spcola.compilation.cache import KernelCache, is_kept
from spcola.compilation.decorators import compiled, compiled_inline, compiled_sums

__all__ = [
    "Bands",
    "KernelCache",
    "compiled",
    "compiled_inline",
    "compiled_sums",
    "is_kept",
    "usable_threads",
]
