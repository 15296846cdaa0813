"""Maplets solved anew from their images: ``spcola spc lithos``."""

from fusion.stages.lithos.options import ConstraintKind, LithosOptions, Purpose, StartKind
from fusion.stages.lithos.result import PHOTOCLINOMETRY_KEYS, LithosResult
from fusion.stages.lithos.returns import lidar_kind
from fusion.stages.lithos.solved import lithos_solution

__all__ = [
    "PHOTOCLINOMETRY_KEYS",
    "ConstraintKind",
    "LithosOptions",
    "LithosResult",
    "Purpose",
    "StartKind",
    "lidar_kind",
    "lithos_solution",
]
