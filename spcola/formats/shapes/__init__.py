"""Shape files: ICQ, OBJ, PLY."""

from spcola.formats.shapes.icq import read_icq, write_icq
from spcola.formats.shapes.obj import FacesFrom, Unit, read_obj_mesh, write_obj_mesh
from spcola.formats.shapes.shape import read_shape, recognise_shape

__all__ = [
    "FacesFrom",
    "Unit",
    "read_icq",
    "read_obj_mesh",
    "read_shape",
    "recognise_shape",
    "write_icq",
    "write_obj_mesh",
]
