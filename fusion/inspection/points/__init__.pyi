from .moved import check_target as check_target
from .moved import write_moved as write_moved
from .sources import PointSource as PointSource
from .sources import read_points as read_points
