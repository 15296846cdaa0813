"""Line-scan and rolling-shutter images."""

from spcola.camera.linescan.image import LineScanImage
from spcola.camera.linescan.scan import LineScan, ScannedPoints, project_scan, scan_rays
from spcola.camera.linescan.states import interpolate_axes, interpolate_positions

__all__ = [
    "LineScan",
    "LineScanImage",
    "ScannedPoints",
    "interpolate_axes",
    "interpolate_positions",
    "project_scan",
    "scan_rays",
]
