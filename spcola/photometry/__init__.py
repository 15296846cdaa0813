"""Light on a surface: photometric functions, shadows, rendering, slopes from images."""

from spcola.photometry.functions import PhotometricFunction, lunar_lambert, photometric_function
from spcola.photometry.ortho_image import OrthoImage, ortho_rectify, view_of
from spcola.photometry.rendering import render
from spcola.photometry.slope_covariance import MOST_INCIDENCE, SlopeVariance, slope_variance

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
