"""Forecast of the fusion."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

from fusion.fusing import fuse_maplet
from fusion.fusing.uncertainty import ImageSlopes
from fusion.inspection.forecasts.situation import Situation
from fusion.inspection.forecasts.timing import timed_sample
from fusion.inspection.forecasts.values import Basis, StageForecast
from fusion.pipeline import Stage
from fusion.runtime import ThreadExecutor
from fusion.scene import Exposures, Scene
from fusion.stages.fuse import fuse_options

_SAMPLE = 24
# Bytes of one point: of the layers in memory, of the results' files, of the kept items.
_POINT_BYTES, _FILE_BYTES, _KEPT_BYTES = 3500.0, 31.5, 45.0
# Mapolas around a maplet, read and projected, take as long as so many fusions.
_GATHERING = 0.5


def fuse_forecast(situation: Situation, stage: Stage) -> StageForecast:
    """Return the forecast of comparing lidar and SPC, and of fusing every maplet."""
    store, points = situation.store(stage), situation.usual_mapola.size**2
    if stage.name in situation.ready:
        count, seconds, share = _sampled(situation, stage)
        kept, basis = min(round(share * count), store.count), Basis.SAMPLE
    else:
        count, kept, basis = len(situation.grids), 0, Basis.SYNTHETIC
        each = situation.synthetic.fusion().seconds * (1.0 + _GATHERING)
        seconds = each * count + _light(situation) * (count + min(count, _SAMPLE))
    disk = (count * _FILE_BYTES + (count - kept) * _KEPT_BYTES) * points
    return StageForecast(
        stage.name, count, kept, seconds, _POINT_BYTES * points, situation.workers, disk, basis
    )


def _sampled(situation: Situation, stage: Stage) -> tuple[int, float, float]:
    """Fuse some maplets as the stage will; return their number, the time of all, and share kept."""
    table, store = situation.settings.fuse, situation.store(stage)
    context = situation.context(stage, store)
    begun = time.perf_counter()
    scene = Scene.of(situation.workspace, light=table.light)
    information = scene.information(partial(context.map, "compare lidar and SPC"))
    before = time.perf_counter() - begun
    options = fuse_options(table)

    def one(name: str) -> Any:
        return store.result(fuse_maplet, scene.parts(name), information, options=options)

    names = scene.targets
    sample = timed_sample(names, one, store, situation.workers)
    kept = sample.kept_share * len(names)
    work = kept * sample.kept_seconds + (len(names) - kept) * sample.seconds
    return len(names), before + work, sample.kept_share


def _light(situation: Situation) -> float:
    """Return the time per maplet of finding from images where its slopes were observed."""
    workspace, light = situation.workspace, situation.settings.fuse.light
    names = workspace.maplet_names()
    images = tuple(workspace.images()) if names else ()
    if light == "none" or not images:
        return 0.0
    names = names[:: max(1, len(names) // (2 * situation.workers))]
    maplets = [workspace.maplet(name) for name in names]
    exposed = Exposures(workspace)
    found = (
        ImageSlopes.of(images, [maplet.grid for maplet in maplets], exposed)
        if light == "auto"
        else ImageSlopes(images, light, exposed)
    )
    found.variance(maplets[0])
    begun = time.perf_counter()
    for _ in ThreadExecutor(situation.workers).stream(found.variance, maplets):
        pass
    return (time.perf_counter() - begun) / len(maplets)
