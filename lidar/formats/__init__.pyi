from .options import LidarOptions as LidarOptions
from .reader import open_lidar as open_lidar
from .recognition import recognise as recognise
