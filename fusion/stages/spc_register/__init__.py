"""States of images that fit the shape: ``spcola spc register``."""

from fusion.stages.spc_register.registered import RegisterOptions, register_states
from fusion.stages.spc_register.result import STATES_FILE, STATES_KEYS, Placed, StatesResult

__all__ = [
    "STATES_FILE",
    "STATES_KEYS",
    "Placed",
    "RegisterOptions",
    "StatesResult",
    "register_states",
]
