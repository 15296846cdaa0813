"""Images of the body, rendered and written."""

from spcola.truth.imaging.detector import Detector, DetectorSettings
from spcola.truth.imaging.files import IMAGE_FORMATS, write_image
from spcola.truth.imaging.raw_files import RawLabel, write_calibration, write_raw_image
from spcola.truth.imaging.rendering import ImageSettings, render

__all__ = [
    "IMAGE_FORMATS",
    "Detector",
    "DetectorSettings",
    "ImageSettings",
    "RawLabel",
    "render",
    "write_calibration",
    "write_image",
    "write_raw_image",
]
