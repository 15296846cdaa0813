"""Adjustment of scans to each other where they overlap."""

from lidar.adjustment.adjustment import adjust_scans
from lidar.adjustment.arcs import RigidArcs, ScanErrorSizes
from lidar.adjustment.overlaps import OverlapEquations, displacement_partials, overlap_equations
from lidar.adjustment.values import AdjustmentOptions, ScanAdjustment

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
