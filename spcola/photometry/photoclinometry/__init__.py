"""Photoclinometry: slopes, albedo and heights from the brightness of images [16 – 23]."""

from spcola.photometry.photoclinometry.albedo_convention import AlbedoConvention
from spcola.photometry.photoclinometry.comparison import Comparison
from spcola.photometry.photoclinometry.constraints import HeightConstraint
from spcola.photometry.photoclinometry.options import PhotoclinometryOptions
from spcola.photometry.photoclinometry.result import Fit, ImageFit, Outcome, Photoclinometry
from spcola.photometry.photoclinometry.solve import solve_photoclinometry

__all__ = [
    "AlbedoConvention",
    "Comparison",
    "Fit",
    "HeightConstraint",
    "ImageFit",
    "Outcome",
    "Photoclinometry",
    "PhotoclinometryOptions",
    "solve_photoclinometry",
]
