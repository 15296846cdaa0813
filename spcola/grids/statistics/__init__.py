"""Correlation and bending of surfaces on grids."""

from spcola.grids.statistics.bending_errors import (
    BENDING_NOISE,
    BENDING_RANGE_NOISE,
    CELL_SHARE,
    bending,
    bending_range,
)
from spcola.grids.statistics.correlation import (
    RobustCovariance,
    autocovariance,
    independent_patches,
    robust_covariance,
    shift_correlations,
    shift_variances,
)

__all__ = [
    "BENDING_NOISE",
    "BENDING_RANGE_NOISE",
    "CELL_SHARE",
    "RobustCovariance",
    "autocovariance",
    "bending",
    "bending_range",
    "independent_patches",
    "robust_covariance",
    "shift_correlations",
    "shift_variances",
]
