"""What making mapolas will take: returns, disk, time and memory, before it begins."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from fusion.adjusting import ScanSource, compared_grids
from fusion.executor import usable_cores
from fusion.locating import located_store
from fusion.settings import Settings
from fusion.stages.mapolas import STAGE, gridding_options, mapola_grids
from fusion.workspace import Workspace
from spcola.arrays import IntArray
from spcola.maplet import MapletGrid

# Grids that are made to see how long one takes.
_SAMPLE = 3
# Rounds in which scans are compared until they stand still.
_ROUNDS = 2
# Bytes that one return takes while its grid is made, and the program without any. Measured: peaks
# over grids of 0.18, 1.2 and 4.7 million returns were 258, 407 and 812 MB.
BYTES_PER_RETURN = 150
PROGRAM_BYTES = 2.6e8


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
    again = _ROUNDS * len(compared_grids(list(grids.values()))) / max(len(grids), 1)
    work = taken * (1.0 + (again if settings.mapolas.adjust else 0.0))
    each = _seconds_per_return(ScanSource(store, options), list(grids.values()), counts)
    cores = usable_cores()
    return {
        "grids": len(grids),
        "with_returns": int(np.count_nonzero(counts)),
        "tiles": store.cubes,
        "returns": taken,
        "scan_bytes": sum(path.stat().st_size for path in workspace.scan_paths()),
        "minutes": work * each / cores / 60.0,
        "memory_mb": (PROGRAM_BYTES + cores * BYTES_PER_RETURN * int(counts.max(initial=0))) / 1e6,
    }


def _seconds_per_return(source: ScanSource, grids: Sequence[MapletGrid], counts: IntArray) -> float:
    """Time that one return takes on one core, by grids of a middling number of returns."""
    filled = np.flatnonzero(counts)
    if not len(filled):
        return 0.0
    middling = filled[np.argsort(counts[filled])][len(filled) // 2 :][:_SAMPLE]
    chosen = [grids[number] for number in middling]
    # The first one may still be compiled.
    source.gridded("forecast", chosen[0], None)
    start = time.perf_counter()
    for grid in chosen:
        source.gridded("forecast", grid, None)
    return (time.perf_counter() - start) / float(counts[middling].sum())
