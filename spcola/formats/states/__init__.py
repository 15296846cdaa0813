"""States of images in files: ISIS cubes, PDS labels, ISD, tables of poses, COLMAP models."""

from spcola.formats.states.colmap import read_colmap
from spcola.formats.states.exposures import Exposure, exposure_of, read_exposures
from spcola.formats.states.isd import read_isd_states
from spcola.formats.states.isis import read_isis_states
from spcola.formats.states.pds import read_pds_state
from spcola.formats.states.poses import read_poses
from spcola.formats.states.suns import read_times

__all__ = [
    "Exposure",
    "exposure_of",
    "read_colmap",
    "read_exposures",
    "read_isd_states",
    "read_isis_states",
    "read_pds_state",
    "read_poses",
    "read_times",
]
