"""Files of cameras: ISD JSON, COLMAP, and the program's own table."""

from spcola.formats.cameras.camera_file import (
    camera_text,
    cameras_in,
    read_cameras,
    write_cameras,
)
from spcola.formats.cameras.colmap import read_colmap_cameras
from spcola.formats.cameras.isd import IsdSensor, read_isd

__all__ = [
    "IsdSensor",
    "camera_text",
    "cameras_in",
    "read_cameras",
    "read_colmap_cameras",
    "read_isd",
    "write_cameras",
]
