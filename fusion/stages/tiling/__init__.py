"""Tiling: a solution with new maplets, seeded from coarser ones or from the shape."""

from fusion.stages.tiling.options import TilingOptions
from fusion.stages.tiling.tiled import TilingResult, forecast_tiling, tile_solution

__all__ = ["TilingOptions", "TilingResult", "forecast_tiling", "tile_solution"]
