"""Forecast of the registration."""

from __future__ import annotations

from fusion.inspection.forecasts.situation import Situation
from fusion.inspection.forecasts.timing import timed_sample
from fusion.inspection.forecasts.values import Basis, StageForecast
from fusion.pipeline import Stage
from fusion.scene import surface_reference
from fusion.stages.register import Matcher
from fusion.surfacematch import MatchOptions

# Mapolas from which blur and errors are estimated before all are matched.
_SAMPLE = 24
# A match is repeated from rotated places in missions with a rotation; reading both surfaces, fit,
# tests and verdict take as long as so many matches of each mapola, and so many seconds besides.
_MATCHES, _BESIDES, _FIT_S = 1.0, 1.0, 1.5
_KEPT_BYTES = 8.0
_WORKER_BYTES = 2500.0


def register_forecast(situation: Situation, stage: Stage) -> StageForecast:
    """Return the forecast of matching all mapolas with SPC, and of the fit."""
    table = situation.settings.registration
    options = MatchOptions(
        capture_m=table.capture_m,
        min_coverage=table.min_coverage,
        min_correlation=table.min_correlation,
    )
    store = situation.store(stage)
    points = situation.usual_mapola.size**2
    ready = stage.name in situation.ready
    if ready and table.by == "topography" and not table.apply:
        names = situation.workspace.mapola_names()
        reference = surface_reference(situation.workspace, table.against)
        matcher = Matcher(situation.workspace, table, reference, None, None, store)
        # Those whose match comes first in a run.
        first = names[:: -(-len(names) // _SAMPLE)]
        sample = timed_sample(
            first, lambda name: matcher.match(name, 0.0), store, situation.workers
        )
        each, share, basis = sample.seconds, sample.kept_share, Basis.SAMPLE
    else:
        names = list(situation.grids)
        each, share, basis = situation.synthetic.match(options), 0.0, Basis.SYNTHETIC
    count = len(names) + 2 * min(_SAMPLE, len(names))
    kept = min(round(share * len(names)), store.count)
    work = (_MATCHES * (count - kept) + _BESIDES * len(names)) * each
    return StageForecast(
        stage.name, len(names), kept, _FIT_S + work, _WORKER_BYTES * points, situation.workers,
        (count - kept) * points * _KEPT_BYTES, basis,
    )  # fmt: skip
