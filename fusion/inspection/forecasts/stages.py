"""Forecast of every stage for a workspace and its settings as they are."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

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
    workspace: Workspace,
    settings: Settings,
    *,
    only: str = "",
    workers: int | None = None,
    states: Mapping[str, str] | None = None,
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
    states : mapping of str to str, optional
        From :meth:`fusion.pipeline.Pipeline.states`, if known.
    """
    stages = load_stages()
    states = states or Pipeline(workspace, settings, stages).states()
    found: dict[str, StageForecast] = {}
    due, ready = set[str](), set[str]()
    for place, stage in enumerate(stages):
        # The report shows the results of all.
        needed = set(stage.needs) or {one.name for one in stages[:place]}
        waits, state = bool(due & needed), states[stage.name]
        blocked = state.startswith("cannot run")
        # What it lacks is made by a stage that is due, or by none.
        if waits or not (blocked or state == "up to date"):
            due.add(stage.name)
        if not waits and not blocked:
            ready.add(stage.name)
    situation = Situation(workspace, settings, workers or usable_cores(), frozenset(ready))
    for stage in stages:
        if only in ("", stage.name):
            state = states[stage.name]
            found[stage.name] = (
                _forecast(situation, stage, state) if stage.name in due else _without(stage, state)
            )
    return found


def _forecast(situation: Situation, stage: Stage, state: str) -> StageForecast:
    """Return the forecast of a stage that is due, or will be."""
    try:
        return _FORECASTS[stage.name](situation, stage)
    except SpcolaError as error:
        missing = state.startswith("cannot run")
        return _without(stage, state) if missing else _unknown(stage, str(error))


def _without(stage: Stage, state: str) -> StageForecast:
    """Return the forecast of a stage that will not run."""
    if state == "up to date":
        return StageForecast(stage.name)
    return _unknown(stage, state.removeprefix("cannot run: "))


def _unknown(stage: Stage, reason: str) -> StageForecast:
    return StageForecast(stage.name, seconds=math.nan, basis=Basis.UNKNOWN, reason=reason)
