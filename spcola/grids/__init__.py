"""Maplets and their grids: sampling, projection onto another grid, gaps."""

from spcola.grids.maplet import Maplet, MapletGrid, overlaps
from spcola.grids.regrid import ProjectedMaplet, project_maplet, project_window

__all__ = [
    "Maplet",
    "MapletGrid",
    "ProjectedMaplet",
    "overlaps",
    "project_maplet",
    "project_window",
]
