"""Adjustment of scans to each other where they overlap."""

from lidar.adjustment.adjustment import AdjustmentOptions, ScanAdjustment, adjust_scans, unadjusted
from lidar.adjustment.nodes import ErrorSizes, Nodes
from lidar.adjustment.overlaps import (
    DEGREES,
    OverlapEquations,
    displacement_rows,
    ground_shares,
    overlap_equations,
)

__all__ = [
    "DEGREES",
    "AdjustmentOptions",
    "ErrorSizes",
    "Nodes",
    "OverlapEquations",
    "ScanAdjustment",
    "adjust_scans",
    "displacement_rows",
    "ground_shares",
    "overlap_equations",
    "unadjusted",
]
