"""Albedo solved on known topography: ``spcola spc albedo``."""

from fusion.stages.albedo.options import AlbedoWork, CentersFrom, GroundKind
from fusion.stages.albedo.result import ALBEDO_FILE, ALBEDO_KEYS, AlbedoResult
from fusion.stages.albedo.solved import albedo_of_bigmaps, albedo_solution

__all__ = [
    "ALBEDO_FILE",
    "ALBEDO_KEYS",
    "AlbedoResult",
    "AlbedoWork",
    "CentersFrom",
    "GroundKind",
    "albedo_of_bigmaps",
    "albedo_solution",
]
