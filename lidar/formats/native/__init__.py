"""The program's own files of scans (HDF5)."""

from lidar.formats.native.blocks import Block, times_of
from lidar.formats.native.scan_file import ScanFile, iter_scan, scan_summary, write_scan

__all__ = [
    "Block",
    "ScanFile",
    "iter_scan",
    "scan_summary",
    "times_of",
    "write_scan",
]
