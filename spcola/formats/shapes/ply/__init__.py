"""PLY files: header, elements, meshes."""

from spcola.formats.shapes.ply.data import read_elements
from spcola.formats.shapes.ply.header import PlyElement, PlyHeader, parse_header
from spcola.formats.shapes.ply.mesh import read_ply_mesh, write_ply_mesh

__all__ = [
    "PlyElement",
    "PlyHeader",
    "parse_header",
    "read_elements",
    "read_ply_mesh",
    "write_ply_mesh",
]
