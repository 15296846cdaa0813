"""Kernels of later stages are compiled in a second process while the first ones run.

Numba compiles one kernel at a time in a process, and a first run compiles for over a minute. The
stages that come last have the largest kernels: a process of its own solves a made-up problem with
them, and what it compiled is loaded from the cache when the run comes to these stages. A run that
is sooner there compiles what it needs itself; that costs time and never a result.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from scipy import ndimage

from fusion.fusing import Constraints, FuseInput, fuse_maplet
from fusion.fusing.uncertainty import DEFAULT_INFORMATION
from fusion.surfacematch import MATCH_KERNEL, Surface, match_surfaces
from spcola.arrays import FloatArray
from spcola.compilation import KernelCache, is_kept
from spcola.grids import Maplet, MapletGrid
from spcola.heights import HeightSystem

_HALF_SIZE = 40
_COMMAND = """
import sys
sys.path[:] = {path!r}
from fusion.stages.compiling import compile_late
compile_late()
"""


@contextmanager
def compiling_ahead() -> Iterator[None]:
    """Compile the kernels of registration and fusion in another process, unless that was done."""
    if not KernelCache.usable or (is_kept(MATCH_KERNEL) and HeightSystem.is_compiled()):
        yield
        return
    quiet = subprocess.DEVNULL
    process = subprocess.Popen(
        [sys.executable, "-c", _COMMAND.format(path=sys.path)],
        stdin=quiet, stdout=quiet, stderr=quiet,
    )  # fmt: skip
    try:
        yield
    finally:
        process.kill()
        process.wait()


def compile_late() -> None:
    """Fuse and match made-up surfaces as the stages do: the last stage first."""
    rough = np.random.default_rng(1).normal(size=(2 * _HALF_SIZE + 1,) * 2)
    height = 5.0 * ndimage.gaussian_filter(rough, 3.0)
    grid = MapletGrid.facing([60.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.5, _HALF_SIZE)
    sigma = np.full(height.shape, 0.05)
    spc = Maplet(name="SPC", grid=grid, height=ndimage.gaussian_filter(height, 1.0), sigma=sigma)
    fuse_maplet(_parts(spc, height, height, 0.02), DEFAULT_INFORMATION)
    # Half of the maplet apart, and weights that span more than single precision does.
    split = np.array(spc.height)
    split[:, _HALF_SIZE - 1 : _HALF_SIZE + 2] = np.nan
    half = np.where(np.arange(len(height)) < _HALF_SIZE - 1, height, np.nan)
    fuse_maplet(
        _parts(spc.with_layers(height=split), half, np.full(height.shape, np.nan), 1e-5),
        DEFAULT_INFORMATION,
    )
    match_surfaces("SPC", grid, Surface(height, sigma), Surface(spc.height, spc.sigma))


def _parts(spc: Maplet, lidar: FloatArray, shape: FloatArray, sigma: float) -> FuseInput:
    """Return what is fused where the lidar has these heights, to `sigma`, and the shape those."""
    known = np.isfinite(lidar)
    constraints = Constraints(lidar, np.where(known, sigma, np.nan), known.astype(np.int32))
    return FuseInput("SPC", spc.grid, spc, constraints, shape, 1e-4 * np.eye(3))
