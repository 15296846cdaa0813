"""Geometry of the scale: frames of images, placement of the lidar, shared errors of pairs."""

from fusion.scaling.geometry.frames import (
    PairFrame,
    PairOptions,
    UnpairedImage,
    frame_of_image,
    pair_size,
)
from fusion.scaling.geometry.placement import LidarPlacement
from fusion.scaling.geometry.sharing import maplet_shares

__all__ = [
    "LidarPlacement",
    "PairFrame",
    "PairOptions",
    "UnpairedImage",
    "frame_of_image",
    "maplet_shares",
    "pair_size",
]
