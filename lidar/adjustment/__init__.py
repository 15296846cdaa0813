"""Adjustment of scans to each other where they overlap."""

from lidar.adjustment.adjustment import AdjustmentOptions, ScanAdjustment, adjust_scans
from lidar.adjustment.arcs import RigidArcs, ScanErrorSizes
from lidar.adjustment.overlaps import OverlapEquations, displacement_partials, overlap_equations

__all__ = [
    "AdjustmentOptions",
    "OverlapEquations",
    "RigidArcs",
    "ScanAdjustment",
    "ScanErrorSizes",
    "adjust_scans",
    "displacement_partials",
    "overlap_equations",
]
