"""The match of two gridded surfaces, one of lidar and one of SPC: their displacement.

Registration and scaling both use it: registration fits a transform to the displacements of mapolas
from maplets, scaling a scale to those between the two bigmaps of each image.
"""

from fusion.surfacematch.match import MATCH_KERNEL, match_surfaces
from fusion.surfacematch.spline import spline_at, spline_coefficients
from fusion.surfacematch.values import Match, MatchOptions, Surface
from fusion.surfacematch.weights import accurate_variance

__all__ = [
    "MATCH_KERNEL",
    "Match",
    "MatchOptions",
    "Surface",
    "accurate_variance",
    "match_surfaces",
    "spline_at",
    "spline_coefficients",
]
