"""Pairs of SPC and lidar bigmaps at the ground of each image."""

from fusion.scaling.pairs.pairs import (
    Pair,
    PairSources,
    make_pair,
    pair_maplet_shares,
    pair_observations,
    rematch,
)
from fusion.scaling.pairs.response import match_response

__all__ = [
    "Pair",
    "PairSources",
    "make_pair",
    "match_response",
    "pair_maplet_shares",
    "pair_observations",
    "rematch",
]
