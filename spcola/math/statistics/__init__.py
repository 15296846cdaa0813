"""Errors that observations share, the sizes of errors, and tails of distributions."""

from spcola.math.statistics.shared_errors import (
    SHARED,
    covariance_root,
    own_share,
    patterns_of,
    strongest,
)
from spcola.math.statistics.tails import chi_square_tail
from spcola.math.statistics.variance_components import SizeLikelihood, most_likely_sizes

__all__ = [
    "SHARED",
    "SizeLikelihood",
    "chi_square_tail",
    "covariance_root",
    "most_likely_sizes",
    "own_share",
    "patterns_of",
    "strongest",
]
