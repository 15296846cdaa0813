"""Least squares of landmarks and image states; bundle adjustment."""

from spcola.control.estimation.bundle_adjustment import Network, NetworkOptions, solve_network
from spcola.control.estimation.landmark_fit import LandmarkSolution, solve_landmark, state_partials
from spcola.control.estimation.state_errors import (
    Fixes,
    by_position_and_pointing,
    measured_sigma,
    state_covariance,
)

__all__ = [
    "Fixes",
    "LandmarkSolution",
    "Network",
    "NetworkOptions",
    "by_position_and_pointing",
    "measured_sigma",
    "solve_landmark",
    "solve_network",
    "state_covariance",
    "state_partials",
]
