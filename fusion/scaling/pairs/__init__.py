"""Pairs of SPC and lidar bigmaps at the ground of each image."""

from fusion.scaling.pairs.pairs import (
    Pair,
    Sources,
    blur_of,
    make_pair,
    maplets_under,
    pair_observations,
    rematched,
)
from fusion.scaling.pairs.response import cell_means, match_response

__all__ = [
    "Pair",
    "Sources",
    "blur_of",
    "cell_means",
    "make_pair",
    "maplets_under",
    "match_response",
    "pair_observations",
    "rematched",
]
