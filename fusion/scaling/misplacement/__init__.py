"""Misplacement of shots: whether they fit better at wrong places, and whether scans agree."""

from fusion.scaling.misplacement.check import PlaceCheck, check_place
from fusion.scaling.misplacement.crossings import compare_crossings
from fusion.scaling.misplacement.scans import ScanChecks, check_scans

__all__ = ["PlaceCheck", "ScanChecks", "check_place", "check_scans", "compare_crossings"]
