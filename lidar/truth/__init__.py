"""Lidar of the synthetic body: raster scans and nadir tracks, their errors, their files."""

from lidar.truth.files import FORMATS, ScanSize, returns_of, scan_size, write_scans
from lidar.truth.scan import make_scan, scan_chunks, scan_name, track_chunks, track_name
from lidar.truth.settings import LidarSettings, ScanErrors, draw_errors
from lidar.truth.track import Track, TrackSettings, plan_tracks

__all__ = [
    "FORMATS",
    "LidarSettings",
    "ScanErrors",
    "ScanSize",
    "Track",
    "TrackSettings",
    "draw_errors",
    "make_scan",
    "plan_tracks",
    "returns_of",
    "scan_chunks",
    "scan_name",
    "scan_size",
    "track_chunks",
    "track_name",
    "write_scans",
]
