"""Lidar files: recognised by their content, read in blocks."""

from lidar.formats.reader import open_lidar, read_scan
from lidar.formats.recognition import recognise
from lidar.formats.sample import ScanSample, read_sample

__all__ = ["ScanSample", "open_lidar", "read_sample", "read_scan", "recognise"]
