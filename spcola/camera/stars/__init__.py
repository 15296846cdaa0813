"""Stars: found in images, identified in a catalogue, and used to calibrate a camera."""

from spcola.camera.stars.calibration import StarCalibration, StarFrame, calibrate
from spcola.camera.stars.catalogue import StarCatalogue
from spcola.camera.stars.centroids import StarPositions, find_stars
from spcola.camera.stars.field import identified_frame
from spcola.camera.stars.parameters import solved_parameters, with_model

__all__ = [
    "StarCalibration",
    "StarCatalogue",
    "StarFrame",
    "StarPositions",
    "calibrate",
    "find_stars",
    "identified_frame",
    "solved_parameters",
    "with_model",
]
