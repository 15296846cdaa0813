"""Point clouds: LAS, LAZ, PLY, PCD."""

from lidar.formats.clouds.las import read_las_system
from lidar.formats.clouds.las_writer import write_las

__all__ = ["read_las_system", "write_las"]
