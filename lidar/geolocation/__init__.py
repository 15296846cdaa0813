"""Location of returns on the body: trajectory, pointing, mirror and range offset."""

from lidar.geolocation.geolocation import (
    NO_TIME,
    OUTSIDE,
    OUTSIDE_KERNELS,
    Geolocation,
    find_geolocation,
    geolocated,
    geolocated_by,
    scan_trajectory,
    turn_of,
)
from lidar.geolocation.mirror import MirrorAngles
from lidar.geolocation.range_shift import RangeShift
from lidar.geolocation.spice_trajectory import KernelPlace

__all__ = [
    "NO_TIME",
    "OUTSIDE",
    "OUTSIDE_KERNELS",
    "Geolocation",
    "KernelPlace",
    "MirrorAngles",
    "RangeShift",
    "find_geolocation",
    "geolocated",
    "geolocated_by",
    "scan_trajectory",
    "turn_of",
]
