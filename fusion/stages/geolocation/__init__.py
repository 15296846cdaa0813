"""Geolocation of scans by their trajectory and pointing."""

from fusion.stages.geolocation.locating import located_store
from fusion.stages.geolocation.return_source import ReturnSource, gridding_options

__all__ = ["ReturnSource", "gridding_options", "located_store"]
