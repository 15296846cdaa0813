"""Files of cameras: ISD JSON, COLMAP, the program's own table, and tables of stars."""

from spcola.formats.cameras.camera_file import read_cameras, write_cameras
from spcola.formats.cameras.colmap import read_colmap_cameras
from spcola.formats.cameras.isd import IsdSensor, read_isd
from spcola.formats.cameras.star_image import read_star_image
from spcola.formats.cameras.star_tables import (
    NominalAttitude,
    read_attitudes,
    read_star_catalogue,
    read_star_positions,
)

__all__ = [
    "IsdSensor",
    "NominalAttitude",
    "read_attitudes",
    "read_cameras",
    "read_colmap_cameras",
    "read_isd",
    "read_star_catalogue",
    "read_star_image",
    "read_star_positions",
    "write_cameras",
]
