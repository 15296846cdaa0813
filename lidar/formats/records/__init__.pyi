from .options import LidarOptions as LidarOptions
