"""The returns of a workspace, geolocated by its settings with :mod:`lidar.geolocation`."""

from fusion.scene.geolocation.kernels import advice_on_unplaced
from fusion.scene.geolocation.located_shots import LocatedShots, located_shots
from fusion.scene.geolocation.locating import geolocator, located_store, return_paths, rotations
from fusion.scene.geolocation.return_source import ReturnSource, gridding_options

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
