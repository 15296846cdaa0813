"""Maplets and their grids: sampling, projection onto another grid, gaps."""

from spcola.grids.maplet import Maplet, MapletGrid, check_layer, overlaps
from spcola.grids.regrid import ProjectedMaplet, project_maplet, project_window

__all__ = [
    "Maplet",
    "MapletGrid",
    "ProjectedMaplet",
    "check_layer",
    "overlaps",
    "project_maplet",
    "project_window",
]
