"""What surrounds one maplet in a workspace: the data model of the fusion."""

from fusion.scene.around import NearMaplets, caster_around
from fusion.scene.exposures import Exposures
from fusion.scene.scene import LightSource, Scene, read_registration
from fusion.scene.surfaces import Reference, maplets_around, surface_reference

__all__ = [
    "Exposures",
    "LightSource",
    "NearMaplets",
    "Reference",
    "Scene",
    "caster_around",
    "maplets_around",
    "read_registration",
    "surface_reference",
]
