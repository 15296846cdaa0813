"""Files with states of images: tables of ISIS cubes, ISD, tables of poses, COLMAP models."""

from spcola.formats.states.colmap import ColmapCamera, read_colmap
from spcola.formats.states.isd import read_isd
from spcola.formats.states.isis import isis_states
from spcola.formats.states.poses import read_poses

__all__ = ["ColmapCamera", "isis_states", "read_colmap", "read_isd", "read_poses"]
