"""The match of two surfaces: how registration and scaling find displacements."""

from fusion.surfacematch.displacing import BORDER, gauss_newton, spline_of
from fusion.surfacematch.match import match_surfaces
from fusion.surfacematch.values import Match, MatchOptions, Surface, judged_match, unmatched
from fusion.surfacematch.weights import BEST_SHARE

__all__ = [
    "BEST_SHARE",
    "BORDER",
    "Match",
    "MatchOptions",
    "Surface",
    "gauss_newton",
    "judged_match",
    "match_surfaces",
    "spline_of",
    "unmatched",
]
