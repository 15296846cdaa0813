"""Registration by images, alone or together with topography."""

from fusion.registration.observations.by_images import ImagedMapolas, place_mapolas
from fusion.registration.observations.image_registration import (
    ObservationTypes,
    image_registration_json,
    register_with_images,
)

__all__ = [
    "ImagedMapolas",
    "ObservationTypes",
    "image_registration_json",
    "place_mapolas",
    "register_with_images",
]
