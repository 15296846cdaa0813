"""What making mapolas will take: returns, disk, time and memory, before it begins."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from fusion.runtime import ThreadExecutor, usable_cores
from fusion.runtime.machine import PROGRAM_BYTES
from fusion.stages.geolocation import located_store
from fusion.stages.mapolas import STAGE, ScanSource, compared_grids, gridding_options, mapola_grids
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings
from spcola.arrays import IntArray
from spcola.grids import MapletGrid

# Grids for each core that are made to see how long one takes.
_SAMPLE = 2
# Rounds in which scans are compared until they stand still, and how many times as long it takes to
# compare scans on a grid as to make it. Measured on 57 million returns: 1.6.
_ROUNDS = 2
_COMPARING = 1.6
# Bytes that one return takes while its grid is made. Measured: peaks over grids of 0.18, 1.2 and
# 4.7 million returns were 258, 407 and 812 MB.
BYTES_PER_RETURN = 150


def mapolas_forecast(workspace: Workspace, settings: Settings) -> dict[str, Any]:
    """Return what the mapolas of a workspace will take; empty where none can be made.

    A few of them are made, and thrown away, to see how long one return takes here and now. Memory
    is without what the system keeps of files that are read, and gives back when it is needed.
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
    each = _seconds_per_return(ScanSource(store, options), list(grids.values()), counts, cores)
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
    source: ScanSource, grids: Sequence[MapletGrid], counts: IntArray, cores: int
) -> float:
    """Time that one return takes on all cores together, by grids of a middling number of returns.

    Cores share memory, caches and perhaps other work: what one does alone says too little.
    """
    filled = np.flatnonzero(counts)
    if not len(filled):
        return 0.0
    middle, wanted = len(filled) // 2, min(_SAMPLE * cores, len(filled))
    begin = min(middle, len(filled) - wanted)
    chosen = filled[np.argsort(counts[filled])][begin : begin + wanted]
    # The first one may still be compiled.
    source.gridded("forecast", grids[chosen[0]], None)
    start = time.perf_counter()
    ThreadExecutor(cores).map(
        lambda k: source.gridded("forecast", grids[k], None)[1].scan.size, chosen
    )
    return (time.perf_counter() - start) / float(counts[chosen].sum())
