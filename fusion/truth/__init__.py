"""Synthetic missions, and the assessment of models against their truth."""

from fusion.truth.blind.settings import on_base
from fusion.truth.demo import demonstrate, errors_table, recovery_table
from fusion.truth.mission import make_mission
from fusion.truth.named import PRESETS
from fusion.truth.planted import read_truth
from fusion.truth.restoring import changed
from fusion.truth.size import mission_size

__all__ = [
    "PRESETS",
    "changed",
    "demonstrate",
    "errors_table",
    "make_mission",
    "mission_size",
    "on_base",
    "read_truth",
    "recovery_table",
]
