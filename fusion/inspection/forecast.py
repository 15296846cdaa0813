"""Forecast of returns, disk, time and memory for making mapolas."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from fusion.geolocation import ReturnSource, gridding_options, located_store
from fusion.runtime import ThreadExecutor, usable_cores
from fusion.runtime.machine import PROGRAM_BYTES
from fusion.stages.mapolas import STAGE, compared_grids, mapola_grids
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings
from spcola.arrays import IntArray
from spcola.grids import MapletGrid

# Grids for each core that are made to time them.
_SAMPLE = 2
# Iterations of the comparison of scans until it converges, and its time on a grid relative to
# making the grid. Measured on 57 million returns: 1.6.
_ROUNDS = 2
_COMPARING = 1.6
# Memory of one return while its grid is made, bytes. Measured: peaks over grids of 0.18, 1.2 and
# 4.7 million returns were 258, 407 and 812 MB.
BYTES_PER_RETURN = 150


def mapolas_forecast(workspace: Workspace, settings: Settings) -> dict[str, Any]:
    """Return the forecast for the mapolas of a workspace; empty if none can be made.

    A few of them are made, and discarded, to time one return on this machine. Memory is without
    the system's cache of files.

    Parameters
    ----------
    workspace : Workspace
    settings : Settings
    """
    if STAGE.missing(workspace, settings):
        return {}
    grids = mapola_grids(workspace, settings)
    store = located_store(workspace, settings.mapolas, settings.spin, settings.spice)
    options = gridding_options(settings.mapolas)
    counts = np.array([store.count_inside(options.box(grid)) for grid in grids.values()])
    taken = int(counts.sum())
    again = _ROUNDS * _COMPARING * len(compared_grids(list(grids.values()))) / max(len(grids), 1)
    work = taken * (1.0 + (again if settings.mapolas.adjust else 0.0))
    cores = usable_cores()
    each = _seconds_per_return(ReturnSource(store, options), list(grids.values()), counts, cores)
    return {
        "grids": len(grids),
        "with_returns": int(np.count_nonzero(counts)),
        "tiles": store.cubes,
        "returns": taken,
        "scan_bytes": sum(path.stat().st_size for path in workspace.scan_paths()),
        "minutes": work * each / 60.0,
        "memory_mb": (PROGRAM_BYTES + cores * BYTES_PER_RETURN * int(counts.max(initial=0))) / 1e6,
    }


def _seconds_per_return(
    source: ReturnSource, grids: Sequence[MapletGrid], counts: IntArray, cores: int
) -> float:
    """Return the time per return on all cores together, measured on grids of median size.

    Cores share memory, caches and other work: the speed of one alone is no guide.
    """
    filled = np.flatnonzero(counts)
    if not len(filled):
        return 0.0
    middle, wanted = len(filled) // 2, min(_SAMPLE * cores, len(filled))
    begin = min(middle, len(filled) - wanted)
    chosen = filled[np.argsort(counts[filled])][begin : begin + wanted]
    # The first one may still be compiled.
    source.gridded("forecast", grids[chosen[0]])
    start = time.perf_counter()
    for _ in ThreadExecutor(cores).stream(lambda k: source.gridded("forecast", grids[k]), chosen):
        pass
    return (time.perf_counter() - start) / float(counts[chosen].sum())
