"""Files of cameras: ISD JSON, instrument kernels, COLMAP, and the program's own table."""

from spcola.formats.cameras.isd import IsdSensor, read_isd

__all__ = ["IsdSensor", "read_isd"]
