"""Cameras from instrument kernels, and from their keywords in the labels of ISIS cubes."""

from spcola.spice.instruments.cube import read_cube_camera, read_cube_lines
from spcola.spice.instruments.kernel import read_instrument_kernels

__all__ = ["read_cube_camera", "read_cube_lines", "read_instrument_kernels"]
