"""Common parts of the readers: options, records of bytes and rows, times, and screening."""

from lidar.formats.records.options import LidarOptions

__all__ = ["LidarOptions"]
