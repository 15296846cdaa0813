from .reader import open_lidar as open_lidar
from .reader import read_scan as read_scan
from .recognition import recognise as recognise
