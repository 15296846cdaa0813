"""Least squares of single landmarks and image states, and the errors of states."""

from spcola.control.estimation.landmark_fit import LandmarkSolution, solve_landmark, state_partials
from spcola.control.estimation.state_errors import (
    MeasuredLandmarks,
    by_position_and_pointing,
    measured_sigma,
    shift_covariance,
    state_covariance,
)

__all__ = [
    "LandmarkSolution",
    "MeasuredLandmarks",
    "by_position_and_pointing",
    "measured_sigma",
    "shift_covariance",
    "solve_landmark",
    "state_covariance",
    "state_partials",
]
