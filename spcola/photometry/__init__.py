"""Light on a surface: photometric functions, shadows, rendering, slopes from images."""

from spcola.photometry.functions import PhotometricFunction, lunar_lambert, photometric_function
from spcola.photometry.ortho_image import OrthoImage, ortho_rectify, view_of
from spcola.photometry.photoclinometry import MOST_INCIDENCE, SlopeVariance, slope_variance
from spcola.photometry.rendering import render

__all__ = [
    "MOST_INCIDENCE",
    "OrthoImage",
    "PhotometricFunction",
    "SlopeVariance",
    "lunar_lambert",
    "ortho_rectify",
    "photometric_function",
    "render",
    "slope_variance",
    "view_of",
]
