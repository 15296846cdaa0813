"""The returns of a workspace, geolocated by its settings with :mod:`lidar.geolocation`."""

from fusion.geolocation.kernels import advice_on_unplaced
from fusion.geolocation.located_shots import LocatedShots, located_shots
from fusion.geolocation.locating import geolocator, located_store, return_paths, rotations
from fusion.geolocation.return_source import ReturnSource, gridding_options

__all__ = [
    "LocatedShots",
    "ReturnSource",
    "advice_on_unplaced",
    "geolocator",
    "gridding_options",
    "located_shots",
    "located_store",
    "return_paths",
    "rotations",
]
