"""Mapolas: grids of returns."""

from fusion.stages.mapolas.adjusting import compared_grids
from fusion.stages.mapolas.stage import STAGE, mapola_grids

__all__ = ["STAGE", "compared_grids", "mapola_grids"]
