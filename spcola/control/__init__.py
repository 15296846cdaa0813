"""Landmarks, their overlaps, and the change of a solution's scale."""

from spcola.control.landmark import Landmark, MapOverlap
from spcola.control.overlaps import map_overlap, overlaps_of
from spcola.control.scaling import scaled

__all__ = ["Landmark", "MapOverlap", "map_overlap", "overlaps_of", "scaled"]
