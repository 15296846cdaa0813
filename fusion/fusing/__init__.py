"""Fused heights: lidar heights as constraints in the slope-to-height integration."""

from fusion.fusing.constraints import Candidate, Constraints, lidar_constraints
from fusion.fusing.fuse import FuseInput, FuseOptions, FuseResult, fuse_maplet
from fusion.fusing.illumination import Illumination
from fusion.fusing.information import (
    DEFAULT_INFORMATION,
    Comparison,
    SlopeInformation,
    estimate_information,
)

__all__ = [
    "DEFAULT_INFORMATION",
    "Candidate",
    "Comparison",
    "Constraints",
    "FuseInput",
    "FuseOptions",
    "FuseResult",
    "Illumination",
    "SlopeInformation",
    "estimate_information",
    "fuse_maplet",
    "lidar_constraints",
]
