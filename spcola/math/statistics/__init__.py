"""Errors that observations share, and the sizes of errors."""

from spcola.math.statistics.shared_errors import (
    SHARED,
    covariance_root,
    own_share,
    patterns_of,
    strongest,
)
from spcola.math.statistics.variance_components import most_likely_sizes

__all__ = [
    "SHARED",
    "covariance_root",
    "most_likely_sizes",
    "own_share",
    "patterns_of",
    "strongest",
]
