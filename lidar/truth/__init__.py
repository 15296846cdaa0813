"""Scans of the synthetic body."""

from lidar.truth.files import SCAN_FORMATS, scan_size, write_scans
from lidar.truth.scan import Observation, scan_chunks, scan_name
from lidar.truth.settings import LidarSettings, ScanErrors
from lidar.truth.track import TrackSettings

__all__ = [
    "SCAN_FORMATS",
    "LidarSettings",
    "Observation",
    "ScanErrors",
    "TrackSettings",
    "scan_chunks",
    "scan_name",
    "scan_size",
    "write_scans",
]
