"""Tiling: new maplets over a body or a region, with heights of coarser ones or of a shape."""

from spcola.shape.tiling.circle import Circle
from spcola.shape.tiling.ground import Ground
from spcola.shape.tiling.maplet_mesh import mesh_of_maplets
from spcola.shape.tiling.seeds import Seed, seeded

__all__ = ["Circle", "Ground", "Seed", "mesh_of_maplets", "seeded"]
