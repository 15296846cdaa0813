"""Forecast of returns, disk, time and memory for making mapolas."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fusion.inspection.forecasts.situation import Situation
from fusion.inspection.forecasts.timing import Sample, timed_sample
from fusion.inspection.forecasts.values import Basis, StageForecast
from fusion.pipeline import Stage
from fusion.runtime.machine import PROGRAM_BYTES
from fusion.scene.geolocation import ReturnSource
from fusion.stages.mapolas import compared_grids
from lidar.gridding import Gridding, grid_returns
from spcola.arrays import IntArray

# Grids for each core that are made to time them.
_SAMPLE = 3
# Iterations of the comparison of scans until it converges, and its time on a grid relative to
# making the grid. Measured on 57 million returns: 1.6.
_ROUNDS = 2
_COMPARING = 1.6
# Memory of one return while its grid is made, bytes. Measured: peaks over grids of 0.18, 1.2 and
# 4.7 million returns were 258, 407 and 812 MB.
BYTES_PER_RETURN = 150
# Bytes of one point in the files of a mapola and in its kept item; time to write one, seconds.
_FILE_BYTES, _KEPT_BYTES = 31.0, 40.0
_WRITING_S = 3e-3


def mapola_forecast(situation: Situation, stage: Stage) -> StageForecast:
    """Return the forecast of gridding all returns, with items of the stage itself."""
    found = _sampled(situation, stage)
    content, points = found.content, situation.usual_mapola.size**2
    items = int(content["with_returns"])
    kept = min(round(found.kept_share * items), situation.store(stage).count)
    # Scans are compared again in any case.
    seconds = found.comparing_s + found.gridding_s * (1.0 - kept / max(items, 1))
    disk = (items * _FILE_BYTES + (items - kept) * _KEPT_BYTES) * points
    return StageForecast(
        stage.name, items, kept, seconds + _WRITING_S * items, BYTES_PER_RETURN * found.most,
        situation.workers, disk, Basis.SAMPLE, details=content,
    )  # fmt: skip


@dataclass(frozen=True)
class _Sampled:
    """Grids that were timed.

    Attributes
    ----------
    content : dict
        Grids, returns, bytes of scans, minutes and memory (MB).
    comparing_s, gridding_s : float
        Time of comparing scans and of gridding all mapolas.
    most : int
        Returns of the largest grid.
    kept_share : float
        Share of grids that were found kept.
    """

    content: dict[str, Any]
    comparing_s: float
    gridding_s: float
    most: int
    kept_share: float


def _sampled(situation: Situation, stage: Stage) -> _Sampled:
    """Count the returns of all grids, and make some to time them."""
    workspace, grids = situation.workspace, situation.grids
    table = situation.settings.mapolas
    context = situation.context(stage, situation.store(stage))
    source = ReturnSource.of(context, workspace.adjustment() if table.adjust else None)
    counts = np.array([source.store.count_inside(source.options.box(g)) for g in grids.values()])
    taken, most = int(counts.sum()), int(counts.max(initial=0))
    sample, sampled = _timed(situation, stage, source, counts)
    each = sample.seconds / sampled if sampled else 0.0
    again = _ROUNDS * _COMPARING * len(compared_grids(list(grids.values()))) / max(len(grids), 1)
    gridding, comparing = taken * each, taken * each * again if table.adjust else 0.0
    content = {
        "grids": len(grids),
        "with_returns": int(np.count_nonzero(counts)),
        "tiles": source.store.cubes,
        "returns": taken,
        "scan_bytes": sum(path.stat().st_size for path in workspace.scan_paths()),
        "minutes": (gridding + comparing) / 60.0,
        "memory_mb": (PROGRAM_BYTES + situation.workers * BYTES_PER_RETURN * most) / 1e6,
    }
    return _Sampled(content, comparing, gridding, most, sample.kept_share)


def _timed(
    situation: Situation, stage: Stage, source: ReturnSource, counts: IntArray
) -> tuple[Sample, float]:
    """Make grids of median size as the stage does; return them with their mean number of returns.

    Cores share memory, caches and other work: the speed of one alone is no guide.
    """
    filled = np.flatnonzero(counts)
    if not len(filled):
        return Sample(0.0, 0.0, 0.0), 0.0
    grids, store = list(situation.grids.items()), situation.store(stage)
    wanted = min(_SAMPLE * situation.workers, len(filled))
    begin = min(len(filled) // 2, len(filled) - wanted)
    chosen = filled[np.argsort(counts[filled])][begin : begin + wanted]
    by_name = {grids[k][0]: grids[k][1] for k in chosen}
    # Grids without the displacements of scans, which are not known yet, are of no further use.
    keeps = source.adjustment is not None or not situation.settings.mapolas.adjust

    def one(name: str) -> Gridding:
        around = source.around(by_name[name]).of_own_scans()
        if keeps:
            return store.result(grid_returns, name, by_name[name], around, options=source.options)
        store.computed.append(name)
        return grid_returns(name, by_name[name], around, options=source.options)

    return timed_sample(list(by_name), one, store, situation.workers), float(counts[chosen].mean())
