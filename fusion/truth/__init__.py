"""Synthetic missions, and the assessment of models against their truth."""

from fusion.truth.demo import demonstrate, errors_table, recovery_table
from fusion.truth.mission import make_mission
from fusion.truth.planted import Planted, read_truth
from fusion.truth.presets import PRESETS
from fusion.truth.restoring import changed
from fusion.truth.size import mission_size

__all__ = [
    "PRESETS",
    "Planted",
    "changed",
    "demonstrate",
    "errors_table",
    "make_mission",
    "mission_size",
    "read_truth",
    "recovery_table",
]
