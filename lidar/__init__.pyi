from .formats import open_lidar as open_lidar
from .formats import read_scan as read_scan
from .gridding import GriddingOptions as GriddingOptions
from .gridding import Mapola as Mapola
from .gridding import grid_returns as grid_returns
from .gridding import make_mapola as make_mapola
from .scans import Returns as Returns
from .scans import Scan as Scan
