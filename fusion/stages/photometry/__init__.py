"""Photometric functions fitted to the images of a solution over its maplets."""

from fusion.stages.photometry.fitted import (
    PHOTOMETRY_FILE,
    PHOTOMETRY_KEYS,
    fit_photometry,
    photometry_lines,
)
from fusion.stages.photometry.sampling import PhotometryOptions

__all__ = [
    "PHOTOMETRY_FILE",
    "PHOTOMETRY_KEYS",
    "PhotometryOptions",
    "fit_photometry",
    "photometry_lines",
]
