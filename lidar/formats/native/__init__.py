"""The program's own HDF5 files: scans, mapolas, adjustments."""

from lidar.formats.native.adjustment import ADJUSTMENT_HDF5, read_adjustment, write_adjustment
from lidar.formats.native.blocks import Block, times_of
from lidar.formats.native.mapola import MAPOLAS_HDF5, mapola_names, read_mapola, write_mapolas
from lidar.formats.native.scan_file import ScanFile, iter_scan, scan_summary, write_scan

__all__ = [
    "ADJUSTMENT_HDF5",
    "MAPOLAS_HDF5",
    "Block",
    "ScanFile",
    "iter_scan",
    "mapola_names",
    "read_adjustment",
    "read_mapola",
    "scan_summary",
    "times_of",
    "write_adjustment",
    "write_mapolas",
    "write_scan",
]
