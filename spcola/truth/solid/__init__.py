"""A body that may overhang: a closed mesh, built on a given base or on the smooth shape."""

from spcola.truth.solid.mesh_surface import MeshSurface
from spcola.truth.solid.rough_shape import RoughShapeSettings, rough_shape
from spcola.truth.solid.settings import FineSite, SolidSettings
from spcola.truth.solid.solid_body import SolidBody

__all__ = [
    "FineSite",
    "MeshSurface",
    "RoughShapeSettings",
    "SolidBody",
    "SolidSettings",
    "rough_shape",
]
