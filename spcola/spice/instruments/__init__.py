"""Cameras from instrument kernels."""

from spcola.spice.instruments.kernel import read_instrument_kernels

__all__ = ["read_instrument_kernels"]
