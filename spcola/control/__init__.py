"""Landmarks, and the change of a solution's scale."""

from spcola.control.landmark import Landmark, MapOverlap
from spcola.control.scaling import scaled

__all__ = ["Landmark", "MapOverlap", "scaled"]
