"""Planted and recovered values of a synthetic mission, for the report of its workspace."""

from fusion.report.planted.tables import errors_table, planted_table
from fusion.report.planted.values import (
    PLANTED_FILE,
    RecoveredParameter,
    SurfaceErrors,
    read_planted,
    write_planted,
)

__all__ = [
    "PLANTED_FILE",
    "RecoveredParameter",
    "SurfaceErrors",
    "errors_table",
    "planted_table",
    "read_planted",
    "write_planted",
]
