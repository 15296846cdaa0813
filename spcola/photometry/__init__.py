"""Light on a surface: shadows, ortho-images, rendering, slopes from images."""

from spcola.photometry.ortho_image import OrthoImage, ortho_rectify, view_of
from spcola.photometry.rendering import render_view
from spcola.photometry.slope_covariance import MOST_INCIDENCE, SlopeVariance, slope_variance

__all__ = [
    "MOST_INCIDENCE",
    "OrthoImage",
    "SlopeVariance",
    "ortho_rectify",
    "render_view",
    "slope_variance",
    "view_of",
]
