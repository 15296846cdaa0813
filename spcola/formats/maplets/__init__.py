"""Maplet files (.MAP) and their sigma files."""

from spcola.formats.maplets.map import read_map, read_maplet, write_maplet
from spcola.formats.maplets.map_header import map_length
from spcola.formats.maplets.map_parts import MapParts
from spcola.formats.maplets.sigma import read_sigma, sigma_path

__all__ = [
    "MapParts",
    "map_length",
    "read_map",
    "read_maplet",
    "read_sigma",
    "sigma_path",
    "write_maplet",
]
