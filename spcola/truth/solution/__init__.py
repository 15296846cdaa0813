"""Maplets, landmarks and shape of an SPC solution with errors."""

from spcola.truth.solution.landmarks import landmarks_of, measure_landmarks
from spcola.truth.solution.solution import (
    SolutionSettings,
    heights_in_frame,
    make_maplet,
    maplet_directions,
    spc_shape,
)

__all__ = [
    "SolutionSettings",
    "heights_in_frame",
    "landmarks_of",
    "make_maplet",
    "maplet_directions",
    "measure_landmarks",
    "spc_shape",
]
