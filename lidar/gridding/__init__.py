"""Returns to mapolas: cells, planes, outliers, uncertainty."""

from lidar.gridding.bigmap import LidarBigmapOptions, bigmap_from_returns
from lidar.gridding.gridding import Gridding, grid_returns, make_mapola
from lidar.gridding.mapola import Mapola
from lidar.gridding.options import GriddingOptions
from lidar.gridding.point_heights import at_grid_points

__all__ = [
    "Gridding",
    "GriddingOptions",
    "LidarBigmapOptions",
    "Mapola",
    "at_grid_points",
    "bigmap_from_returns",
    "grid_returns",
    "make_mapola",
]
