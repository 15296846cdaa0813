"""Location of returns on the body: trajectory, pointing, mirror and range offset."""

from lidar.geolocation.geolocation import (
    Geolocation,
    Unlocated,
    find_geolocation,
    geolocated_by,
    scan_trajectory,
)
from lidar.geolocation.mirror import MirrorAngles
from lidar.geolocation.range_shift import RangeShift
from lidar.geolocation.spice_trajectory import KernelPlace

__all__ = [
    "Geolocation",
    "KernelPlace",
    "MirrorAngles",
    "RangeShift",
    "Unlocated",
    "find_geolocation",
    "geolocated_by",
    "scan_trajectory",
]
