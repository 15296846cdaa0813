"""Surfaces of a workspace as they are looked at: windows, tiles, values, profiles, pictures."""

from fusion.service.views.surfaces.cache import LayerCache
from fusion.service.views.surfaces.opening import SurfaceKind, open_surface, surface_names
from fusion.service.views.surfaces.picture import colours_of, png_of
from fusion.service.views.surfaces.sampling import profile, value_at
from fusion.service.views.surfaces.surface import Surface

__all__ = [
    "LayerCache",
    "Surface",
    "SurfaceKind",
    "colours_of",
    "open_surface",
    "png_of",
    "profile",
    "surface_names",
    "value_at",
]
