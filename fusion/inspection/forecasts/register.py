"""Forecast of the registration."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from fusion.inspection.forecasts.situation import Situation
from fusion.inspection.forecasts.timing import NotingStore, Sample, timed_sample
from fusion.inspection.forecasts.values import Basis, StageForecast
from fusion.pipeline import Stage
from fusion.runtime import ThreadExecutor
from fusion.scene import surface_reference
from fusion.scene.geolocation import ReturnSource
from fusion.stages.register import ImageScene, Matcher
from fusion.surfacematch import MatchOptions
from fusion.workspace.settings.processing import RegisterSettings
from spcola.grids import Maplet

# Mapolas from which blur and errors are estimated before all are matched.
_SAMPLE = 24
# A match is repeated from rotated places in missions with a rotation; reading both surfaces, fit,
# tests and verdict take as long as so many matches of each mapola, and so many seconds besides.
_MATCHES, _BESIDES, _FIT_S = 1.0, 1.0, 1.5
_KEPT_BYTES = 8.0
_WORKER_BYTES = 2500.0


def register_forecast(situation: Situation, stage: Stage) -> StageForecast:
    """Return the forecast of matching all mapolas with SPC, and of the fit."""
    table, store = situation.settings.registration, situation.store(stage)
    names, sample, basis = _matching(situation, stage, store)
    each, share = sample.seconds, sample.kept_share
    # Of returns no spectrum of errors is estimated.
    before = 1 if table.by == "returns" else 2
    count = len(names) + before * min(_SAMPLE, len(names))
    kept = min(round(share * len(names)), store.count)
    seconds = _FIT_S + (_MATCHES * (count - kept) + _BESIDES * len(names)) * each
    seconds += situation.synthetic.relief(min(_SAMPLE, len(names)), table.capture_m)
    if table.by in ("images", "both") and not table.apply:
        seconds += _imaging(situation, names, ready=stage.name in situation.ready)
    points = situation.usual_mapola.size**2
    return StageForecast(
        stage.name, len(names), kept, seconds, _WORKER_BYTES * points, situation.workers,
        (count - kept) * points * _KEPT_BYTES, basis,
    )  # fmt: skip


def _matching(
    situation: Situation, stage: Stage, store: NotingStore
) -> tuple[list[str], Sample, Basis]:
    """Return the mapolas that are matched, and the time of a match."""
    workspace, table = situation.workspace, situation.settings.registration
    ready = stage.name in situation.ready
    if table.by == "returns" and not table.apply and (ready or workspace.maplet_names()):
        return _of_returns(situation, stage, store)
    if not ready:
        options = MatchOptions(
            capture_m=table.capture_m,
            min_coverage=table.min_coverage,
            min_correlation=table.min_correlation,
        )
        made_up = situation.synthetic.match(options)
        return list(situation.grids), Sample(made_up, 0.0, 0.0), Basis.SYNTHETIC
    names = workspace.mapola_names()
    matcher = _matcher(situation, table, store)
    first = names[:: -(-len(names) // _SAMPLE)]
    sample = timed_sample(first, lambda name: matcher.match(name, 0.0), store, situation.workers)
    return names, sample, Basis.SAMPLE


def _of_returns(
    situation: Situation, stage: Stage, store: NotingStore
) -> tuple[list[str], Sample, Basis]:
    """Return the same if the returns are matched: they and the maplets are there from the start."""
    ready = stage.name in situation.ready
    source = ReturnSource.of(situation.context(stage, store), situation.workspace.adjustment())
    grids = situation.grids
    with tempfile.TemporaryDirectory() as folder:
        # Returns of an adjustment that is still to come match otherwise: these are not kept.
        kept = store if ready else NotingStore(Path(folder), store.version)
        matcher = _matcher(situation, situation.settings.registration, kept)
        sample = timed_sample(
            list(grids)[:: -(-len(grids) // _SAMPLE)],
            lambda name: matcher.match_returns(source, name, grids[name], 0.0),
            kept,
            situation.workers,
        )
    return list(grids), sample, Basis.SAMPLE if ready else Basis.SYNTHETIC


def _matcher(situation: Situation, table: RegisterSettings, store: NotingStore) -> Matcher:
    reference = surface_reference(situation.workspace, table.against)
    return Matcher(situation.workspace, table, reference, None, None, store)


def _imaging(situation: Situation, names: list[str], *, ready: bool) -> float:
    """Return the time of finding mapolas in images, by some of them or of the maplets."""
    workspace, workers = situation.workspace, situation.workers
    ground: Callable[[str], Maplet] = workspace.mapola if ready else workspace.maplet
    sample = [name for name in names if ready or workspace.maplet_path(name).is_file()]
    sample = sample[:: max(1, -(-len(sample) // (2 * workers)))]
    if not sample:
        return 0.0
    begun = time.perf_counter()
    grids = [ground(name).grid for name in sample]
    scene = ImageScene.of(workspace, grids, situation.settings.registration)
    before = time.perf_counter() - begun

    def found(name: str) -> Any:
        return scene.sighting(ground(name))

    if not scene.images:
        return before
    # The first of each worker does not count: code may be compiled then.
    list(ThreadExecutor(workers).stream(found, sample[:workers]))
    begun, rest = time.perf_counter(), sample[workers:] or sample
    list(ThreadExecutor(workers).stream(found, rest))
    return before + len(names) * (time.perf_counter() - begun) / len(rest)
