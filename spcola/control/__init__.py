"""Landmarks, and solutions of another scale."""

from spcola.control.landmark import Landmark, MapOverlap
from spcola.control.scaled_solution import (
    scaled_image,
    scaled_landmark,
    scaled_maplet,
    scaled_nominal,
    scaled_shape,
)

__all__ = [
    "Landmark",
    "MapOverlap",
    "scaled_image",
    "scaled_landmark",
    "scaled_maplet",
    "scaled_nominal",
    "scaled_shape",
]
