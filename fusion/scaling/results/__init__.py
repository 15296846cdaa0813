"""The content of scale.json."""

from fusion.scaling.results.summary import (
    assumed_json,
    per_pair,
    per_shot,
    place_json,
    scale_json,
    scan_places_json,
    unobserved_json,
    unused_pairs,
)

__all__ = [
    "assumed_json",
    "per_pair",
    "per_shot",
    "place_json",
    "scale_json",
    "scan_places_json",
    "unobserved_json",
    "unused_pairs",
]
