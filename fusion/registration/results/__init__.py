"""The content of registration.json, and registrations that are given."""

from fusion.registration.results.apply import GivenRegistration, applied_json, given_registration
from fusion.registration.results.keys import with_old_keys
from fusion.registration.results.scans import ScanEffects, share_matrix
from fusion.registration.results.summary import (
    MatchedMapolas,
    Placement,
    placements_of,
    registration_json,
    scale_influence,
    transform_of,
)

__all__ = [
    "GivenRegistration",
    "MatchedMapolas",
    "Placement",
    "ScanEffects",
    "applied_json",
    "given_registration",
    "placements_of",
    "registration_json",
    "scale_influence",
    "share_matrix",
    "transform_of",
    "with_old_keys",
]
