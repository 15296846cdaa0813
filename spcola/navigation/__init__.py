"""Time, spin of the body, trajectories and nominal states."""

from spcola.navigation.nominal import NominalState
from spcola.navigation.spin import Spin
from spcola.navigation.time import (
    SPICE_LOCK,
    et_from_utc,
    et_from_utcs,
    iso_utc,
    utc_from_et,
)
from spcola.navigation.trajectory import Offset, Trajectory

__all__ = [
    "SPICE_LOCK",
    "NominalState",
    "Offset",
    "Spin",
    "Trajectory",
    "et_from_utc",
    "et_from_utcs",
    "iso_utc",
    "utc_from_et",
]
