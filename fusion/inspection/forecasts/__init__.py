"""Forecast of time, memory and disk of every stage."""

from fusion.inspection.forecasts.stages import stage_forecasts
from fusion.inspection.forecasts.values import Basis, StageForecast, forecast_json, forecast_lines

__all__ = [
    "Basis",
    "StageForecast",
    "forecast_json",
    "forecast_lines",
    "stage_forecasts",
]
