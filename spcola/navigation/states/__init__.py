"""States of images at their exposures: the value, states from tables, and comparison of sources."""

from spcola.navigation.states.comparison import StateDifference, compare_states
from spcola.navigation.states.image_state import ImageState, StateSource
from spcola.navigation.states.tables import PositionTable, RotationTable, StateTables

__all__ = [
    "ImageState",
    "PositionTable",
    "RotationTable",
    "StateDifference",
    "StateSource",
    "StateTables",
    "compare_states",
]
