"""Detectors: pixels of image files, their correction, scaling, thresholds and orientation."""

from spcola.camera.detector.bit_depth import BitDepth, StoredPixels
from spcola.camera.detector.orientation import Direction, Orientation
from spcola.camera.detector.pixels import PixelValues
from spcola.camera.detector.preparation import Preparation, PreparedPixels, prepare_pixels
from spcola.camera.detector.smear import SmearTimes

__all__ = [
    "BitDepth",
    "Direction",
    "Orientation",
    "PixelValues",
    "Preparation",
    "PreparedPixels",
    "SmearTimes",
    "StoredPixels",
    "prepare_pixels",
]
