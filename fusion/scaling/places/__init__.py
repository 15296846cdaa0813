"""Tests whether shots fit better at wrong places, and whether scans agree."""

from fusion.scaling.places.crossings import compare_crossings
from fusion.scaling.places.places import PlaceCheck, check_place
from fusion.scaling.places.scanplaces import ScanPlaces, check_scans

__all__ = ["PlaceCheck", "ScanPlaces", "check_place", "check_scans", "compare_crossings"]
