"""Meshes of fewer facets."""

from __future__ import annotations

import numpy as np

from spcola.errors import InvalidValueError
from spcola.shape.mesh import Mesh


def decimated(mesh: Mesh, facets: int) -> Mesh:
    """Return a mesh with about as many `facets`, or `mesh` itself if it has no more.

    Edges are contracted in the order of the error of the surface (quadric error metrics, Garland
    and Heckbert 1997; Open3D).

    Parameters
    ----------
    mesh : Mesh
    facets : int
        At least 4.

    Raises
    ------
    InvalidValueError
        If fewer are asked for.
    """
    if facets < 4:
        raise InvalidValueError(f"must be at least 4, not {facets}", "facets")
    if len(mesh.facets) <= facets:
        return mesh
    import open3d  # noqa: PLC0415  # slow to import: only where it is needed

    full = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(np.array(mesh.vertices)),
        open3d.utility.Vector3iVector(mesh.facets.astype(np.int32)),
    )
    small = full.simplify_quadric_decimation(facets)
    return Mesh(np.asarray(small.vertices), np.asarray(small.triangles), mesh.name, mesh.remark)
