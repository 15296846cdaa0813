"""Files of mapolas and of the adjustment of scans."""

from lidar.formats.mapolas.adjustment_file import ADJUSTMENT_HDF5, read_adjustment, write_adjustment
from lidar.formats.mapolas.mapola_file import (
    MAPOLA_STORE,
    MAPOLAS_HDF5,
    mapola_names,
    read_mapola,
    write_mapolas,
)

__all__ = [
    "ADJUSTMENT_HDF5",
    "MAPOLAS_HDF5",
    "MAPOLA_STORE",
    "mapola_names",
    "read_adjustment",
    "read_mapola",
    "write_adjustment",
    "write_mapolas",
]
