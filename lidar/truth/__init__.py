"""Scans of the synthetic body."""

from lidar.truth.files import FORMATS, scan_size, write_scans
from lidar.truth.scan import scan_chunks, scan_name, track_chunks, track_name
from lidar.truth.settings import LidarSettings, ScanErrors, draw_errors
from lidar.truth.track import Track, TrackSettings, plan_tracks

__all__ = [
    "FORMATS",
    "LidarSettings",
    "ScanErrors",
    "Track",
    "TrackSettings",
    "draw_errors",
    "plan_tracks",
    "scan_chunks",
    "scan_name",
    "scan_size",
    "track_chunks",
    "track_name",
    "write_scans",
]
