"""Search over all orientations, mirror images and units, for lidar in another frame."""

from fusion.registration.search.closest import Placement, PointSurface, fit_placement
from fusion.registration.search.directions import cells_of
from fusion.registration.search.frame_texts import UNITS
from fusion.registration.search.search import FrameSearch, search_frames

__all__ = [
    "UNITS",
    "FrameSearch",
    "Placement",
    "PointSurface",
    "cells_of",
    "fit_placement",
    "search_frames",
]
