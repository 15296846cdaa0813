"""Forecast of the scale."""

from __future__ import annotations

from dataclasses import replace

from fusion.inspection.forecasts.situation import Situation
from fusion.inspection.forecasts.values import Basis, StageForecast
from fusion.pipeline import Stage
from fusion.stages.scale import sampled_pairs, seconds_of_estimate, seconds_of_searches
from spcola.shape import RayCaster

# Bytes of one point of a pair: in memory, in its two files, in its kept items.
_POINT_BYTES, _FILE_BYTES, _KEPT_BYTES = 4000.0, 6.0, 190.0
# Bytes of one return of a scan that is read as a whole.
_RETURN_BYTES = 250.0
# Shots of the estimates that are timed.
_SHOTS = (250, 750, 1500)
_FIT_S = 1.0
# Bytes of a shot: in memory, in scale.json.
_SHOT_BYTES, _ENTRY_BYTES = 5000.0, 300.0


def scale_forecast(situation: Situation, stage: Stage) -> StageForecast:
    """Return the forecast of pairing all images, or of comparing shots with the shape."""
    if situation.settings.scale.method == "shots":
        return _by_shots(situation, stage)
    store = situation.store(stage)
    context = situation.context(stage, store)
    caster = RayCaster(situation.workspace.shape())
    found = sampled_pairs(
        context, caster, situation.radius, count=3 * situation.workers, seed=store.count
    )
    # Two items each, a bigmap and a pair; the first pair is made before the timed ones.
    computed = len(store.computed) / max(2 * found.sampled, 1)
    kept = min(round(max(1.0 - computed, 0.0) * found.pairs), store.count // 2)
    points = found.points
    left = found.pairs - kept
    # Pairs that were found kept took next to no time.
    each = found.each_s / min(max(computed, 0.25), 1.0)
    return StageForecast(
        stage.name, found.pairs, kept, found.before_s + _FIT_S + left * each,
        _POINT_BYTES * points + _RETURN_BYTES * found.returns, situation.workers,
        points * (found.pairs * _FILE_BYTES + left * _KEPT_BYTES), Basis.SAMPLE,
        shared_bytes=situation.shape_bytes,
    )  # fmt: skip


def _by_shots(situation: Situation, stage: Stage) -> StageForecast:
    """Return the forecast from estimates of few shots, and from searches for some scans."""
    caster = RayCaster(situation.workspace.shape())
    shots = min(situation.settings.scale.max_shots, situation.returns)
    took = seconds_of_searches(situation.context(stage, situation.store(stage)), caster)

    def seconds(count: int) -> float:
        # All shots may be fewer than the least that the settings take.
        some = situation.settings.with_table("scale", max_shots=count) if count < shots else None
        tried = replace(situation, settings=some or situation.settings)
        return seconds_of_estimate(tried.context(stage, tried.store(stage)), caster)

    counts = sorted({min(count, shots) for count in _SHOTS})
    took += _extrapolated(counts, [seconds(count) for count in counts], shots)
    return StageForecast(
        stage.name, len(situation.workspace.scan_names()), 0, took,
        _SHOT_BYTES * shots, situation.workers, _ENTRY_BYTES * shots, Basis.SAMPLE,
    )  # fmt: skip


def _extrapolated(counts: list[int], seconds: list[float], count: int) -> float:
    """Return the time of `count` shots from those of up to three smaller counts.

    Each effect that shots share is in the equations of many of them: their time grows with the
    square of the count.
    """
    if len(counts) < len(_SHOTS) or count <= counts[-1]:
        return seconds[-1]
    few, some, many = counts
    first = (seconds[1] - seconds[0]) / (some - few)
    second = (seconds[2] - seconds[1]) / (many - some)
    curved = max((second - first) / (many - few), 0.0)
    return seconds[2] + (count - many) * max(second + curved * (count - some), 0.0)
