"""The fit of the transform to matched mapolas, with the errors of scans and landmarks."""

from fusion.registration.fit.fit import FitOptions, Registration
from fusion.registration.fit.landmark_errors import LandmarkErrors
from fusion.registration.fit.mapolas import MatchedMapolas, fit_mapolas
from fusion.registration.fit.scan_errors import ScanErrorPatterns, share_matrix

__all__ = [
    "FitOptions",
    "LandmarkErrors",
    "MatchedMapolas",
    "Registration",
    "ScanErrorPatterns",
    "fit_mapolas",
    "share_matrix",
]
