"""Errors of SPC heights, of its slopes from images and of the shape, estimated from the lidar."""

from fusion.fusing.uncertainty.image_slopes import ImageSlopes
from fusion.fusing.uncertainty.shape_errors import ShapeErrors, estimate_shape_errors
from fusion.fusing.uncertainty.spc_errors import (
    DEFAULT_INFORMATION,
    AlignedHeights,
    SlopeInformation,
    estimate_information,
)

__all__ = [
    "DEFAULT_INFORMATION",
    "AlignedHeights",
    "ImageSlopes",
    "ShapeErrors",
    "SlopeInformation",
    "estimate_information",
    "estimate_shape_errors",
]
