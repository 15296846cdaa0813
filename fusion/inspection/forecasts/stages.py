"""Forecast of every stage for a workspace and its settings as they are."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from fusion.inspection.forecasts.fuse import fuse_forecast
from fusion.inspection.forecasts.mapolas import mapola_forecast
from fusion.inspection.forecasts.products import (
    bigmap_forecast,
    ingest_forecast,
    release_forecast,
    report_forecast,
)
from fusion.inspection.forecasts.register import register_forecast
from fusion.inspection.forecasts.scale import scale_forecast
from fusion.inspection.forecasts.situation import Situation
from fusion.inspection.forecasts.values import Basis, StageForecast
from fusion.pipeline import Pipeline, Stage
from fusion.runtime import usable_cores
from fusion.runtime.machine import one_blas_thread
from fusion.stages import load_stages
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings
from spcola.errors import SpcolaError

_FORECASTS: dict[str, Callable[[Situation, Stage], StageForecast]] = {
    "ingest": ingest_forecast,
    "mapolas": mapola_forecast,
    "register": register_forecast,
    "fuse": fuse_forecast,
    "bigmap": bigmap_forecast,
    "scale": scale_forecast,
    "release": release_forecast,
    "report": report_forecast,
}


@one_blas_thread()
def stage_forecasts(
    workspace: Workspace, settings: Settings, *, only: str = "", workers: int | None = None
) -> dict[str, StageForecast]:
    """Return what each stage will take, in the order in which they run.

    A stage that has its inputs makes some of its items to time them, and keeps them: they need not
    be made again. One whose inputs do not exist yet is forecast from the sizes of what is there
    and from made-up items of the same size. A stage that is due makes all later ones due.

    Parameters
    ----------
    workspace : Workspace
    settings : Settings
    only : str, optional
        Name of a stage; by default all.
    workers : int, optional
        Threads of the run; by default one for each core.
    """
    stages = load_stages()
    states = Pipeline(workspace, settings, stages).states()
    found: dict[str, StageForecast] = {}
    due, ready = set[str](), set[str]()
    for place, stage in enumerate(stages):
        # The report shows the results of all.
        needed = set(stage.needs) or {one.name for one in stages[:place]}
        waits, state = bool(due & needed), states[stage.name]
        if state != "up to date" or waits:
            due.add(stage.name)
        if not waits and not state.startswith("cannot run"):
            ready.add(stage.name)
    situation = Situation(workspace, settings, workers or usable_cores(), frozenset(ready))
    for stage in stages:
        if stage.name not in due:
            found[stage.name] = StageForecast(stage.name)
        elif only in ("", stage.name):
            found[stage.name] = _forecast(situation, stage, states[stage.name])
    return found


def _forecast(situation: Situation, stage: Stage, state: str) -> StageForecast:
    """Return the forecast of a stage that is due or waits for others."""
    unknown = StageForecast(stage.name, seconds=math.nan, basis=Basis.UNKNOWN)
    try:
        if state.startswith("cannot run") and not _will_be_ready(situation, stage):
            return replace(unknown, reason=state.removeprefix("cannot run: "))
        return _FORECASTS[stage.name](situation, stage)
    except SpcolaError as error:
        return replace(unknown, reason=str(error))


def _will_be_ready(situation: Situation, stage: Stage) -> bool:
    """Return whether stages before `stage` will make what it lacks."""
    known = {one.name: one for one in load_stages()}
    needed = stage.needs or (() if stage.name == "ingest" else ("ingest",))
    return stage.name in situation.ready or (
        bool(needed) and all(_will_be_ready(situation, known[name]) for name in needed)
    )
