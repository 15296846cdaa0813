"""Fused heights: lidar heights as constraints in the slope-to-height integration."""

from fusion.fusing.constraints import Constraints, RegisteredMapola, gives_means, lidar_constraints
from fusion.fusing.fuse import FuseResult, fuse_maplet
from fusion.fusing.fuse_input import FuseInput, FuseOptions

__all__ = [
    "Constraints",
    "FuseInput",
    "FuseOptions",
    "FuseResult",
    "RegisteredMapola",
    "fuse_maplet",
    "gives_means",
    "lidar_constraints",
]
