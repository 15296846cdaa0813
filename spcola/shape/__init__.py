"""Shape models: meshes, rays cast on them, heights on a grid, coverage by maplets."""

from spcola.shape.decimation import decimated
from spcola.shape.maplet_cover import covering
from spcola.shape.mesh import Mesh
from spcola.shape.rays import Hits, RayCaster
from spcola.shape.samples import sample_surface
from spcola.shape.shape_grid import shape_heights

__all__ = [
    "Hits",
    "Mesh",
    "RayCaster",
    "covering",
    "decimated",
    "sample_surface",
    "shape_heights",
]
