"""Scans, returns and arcs."""

from lidar.scans.arcs import Arcs
from lidar.scans.returns import Returns
from lidar.scans.scan import Scan, join
from lidar.scans.scan_summary import ScanSummary

__all__ = ["Arcs", "Returns", "Scan", "ScanSummary", "join"]
