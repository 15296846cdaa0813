"""Stars: found in images, identified in a catalogue, and used to calibrate a camera."""

from spcola.camera.stars.calibration import StarCalibration, StarFrame, calibrate
from spcola.camera.stars.catalogue import StarCatalogue, apparent_directions
from spcola.camera.stars.centroids import StarPositions, find_stars
from spcola.camera.stars.field import identified_frame
from spcola.camera.stars.identification import identify
from spcola.camera.stars.parameters import SolvedParameters, solved_parameters, with_model

__all__ = [
    "SolvedParameters",
    "StarCalibration",
    "StarCatalogue",
    "StarFrame",
    "StarPositions",
    "apparent_directions",
    "calibrate",
    "find_stars",
    "identified_frame",
    "identify",
    "solved_parameters",
    "with_model",
]
