"""Raw frames of the cameras, with labels, and calibration frames."""

from spcola.truth.raw_frames.detector import Detector, DetectorSettings
from spcola.truth.raw_frames.files import RawLabel, write_calibration, write_raw_image

__all__ = ["Detector", "DetectorSettings", "RawLabel", "write_calibration", "write_raw_image"]
