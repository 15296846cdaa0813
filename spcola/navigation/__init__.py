"""Time, spin of the body, trajectories and nominal states."""

from spcola.navigation.nominal import NominalState
from spcola.navigation.spin import DAYS_PER_CENTURY, SECONDS_PER_DAY, Spin, turned
from spcola.navigation.time import SPICE_LOCK, et_from_utc, et_from_utcs, utc_from_et
from spcola.navigation.trajectory import Offset, Trajectory

__all__ = [
    "DAYS_PER_CENTURY",
    "SECONDS_PER_DAY",
    "SPICE_LOCK",
    "NominalState",
    "Offset",
    "Spin",
    "Trajectory",
    "et_from_utc",
    "et_from_utcs",
    "turned",
    "utc_from_et",
]
