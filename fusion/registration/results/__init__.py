"""The content of registration.json, written and read."""

from fusion.registration.results.applied import applied_json
from fusion.registration.results.fitted import registration_json
from fusion.registration.results.keys import with_old_keys
from fusion.registration.results.read import (
    GivenRegistration,
    MapolaRegistration,
    given_registration,
    mapola_registrations,
    transform_of,
)

__all__ = [
    "GivenRegistration",
    "MapolaRegistration",
    "applied_json",
    "given_registration",
    "mapola_registrations",
    "registration_json",
    "transform_of",
    "with_old_keys",
]
