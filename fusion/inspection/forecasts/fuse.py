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
from spcola.shape import RayCaster, shape_heights

_SAMPLE = 24
# Bytes of one point: of the layers in memory, of the results' files, of the kept items.
_POINT_BYTES, _FILE_BYTES, _KEPT_BYTES = 8000.0, 31.5, 45.0
# Mapolas around a maplet, read and projected, take as long as so many fusions, and so long at
# least.
_PROJECTING, _LEAST_S = 0.5, 0.01


def fuse_forecast(situation: Situation, stage: Stage) -> StageForecast:
    """Return the forecast of comparing lidar and SPC, and of fusing every maplet."""
    store, points = situation.store(stage), situation.usual_mapola.size**2
    if stage.name in situation.ready:
        count, seconds, share = _sampled(situation, stage)
        kept, basis = min(round(share * count), store.count), Basis.SAMPLE
    else:
        count, kept, basis = len(situation.grids), 0, Basis.SYNTHETIC
        each = situation.synthetic.fusion()
        besides = max(_PROJECTING * each, _LEAST_S) + _gathering(situation)
        seconds = each * count + besides * (count + min(count, _SAMPLE))
    disk = (count * _FILE_BYTES + (count - kept) * _KEPT_BYTES) * points
    return StageForecast(
        stage.name, count, kept, seconds, _POINT_BYTES * points, situation.workers, disk, basis,
        shared_bytes=situation.shape_bytes,
    )  # fmt: skip


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


def _gathering(situation: Situation) -> float:
    """Return the time per maplet of reading it, its shape, and where images observed its slopes."""
    workspace, light = situation.workspace, situation.settings.fuse.light
    names = workspace.maplet_names()
    if not names:
        return 0.0
    names = names[:: max(1, len(names) // (2 * situation.workers))]
    images = tuple(workspace.images()) if light != "none" else ()
    caster = RayCaster(workspace.shape()) if workspace.has_shape() else None
    slopes = None
    if images and light != "none":
        grids, exposed = [workspace.maplet(name).grid for name in names], Exposures(workspace)
        slopes = (
            ImageSlopes.of(images, grids, exposed)
            if light == "auto"
            else ImageSlopes(images, light, exposed)
        )

    def gathered(name: str) -> None:
        maplet = workspace.maplet(name)
        if caster is not None:
            shape_heights(caster, maplet.grid, reach=maplet.grid.radius)
        if slopes is not None:
            slopes.variance(maplet)

    gathered(names[0])
    begun = time.perf_counter()
    for _ in ThreadExecutor(situation.workers).stream(gathered, names):
        pass
    return (time.perf_counter() - begun) / len(names)
