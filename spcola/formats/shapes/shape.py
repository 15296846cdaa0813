"""Shapes in any of the formats that are read, recognised by content."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from spcola.errors import FormatError
from spcola.formats.shapes.icq import read_icq
from spcola.formats.shapes.obj import FacesFrom, Unit, read_obj_mesh
from spcola.formats.shapes.ply.mesh import read_ply_mesh
from spcola.formats.text.fortran import is_number
from spcola.formats.text.source import read_bytes
from spcola.shape import Mesh
from spcola.shape.icq import IcqEdges

ShapeFormat = Literal["icq", "obj", "ply"]

# Comments before the first statement are shorter than this, bytes.
_HEAD = 1 << 20
_OBJ_WORDS = frozenset({"v", "vn", "vt", "vp", "f", "o", "g", "s", "mtllib", "usemtl"})


def recognise_shape(path: str | Path) -> ShapeFormat:
    """Return the format of the shape file at `path`, from its first lines.

    PLY begins with ``ply``; ICQ with one whole number alone on its line; OBJ with a statement,
    perhaps after comments.


    Raises
    ------
    FormatError
        If it is none of them.
    """
    content = read_bytes(path, most=_HEAD)
    if content.startswith(b"ply"):
        return "ply"
    for line in content.splitlines():
        words = line.decode("ascii", errors="replace").split()
        if not words or words[0].startswith("#"):
            continue
        if words[0] in _OBJ_WORDS:
            return "obj"
        if len(words) == 1 and is_number(words[0]):
            return "icq"
        break
    raise FormatError("is no shape in a format that is read", path, "give ICQ, OBJ or PLY")


def read_shape(
    path: str | Path,
    *,
    unit: Unit = "km",
    faces_from: FacesFrom = 1,
    icq_edges: IcqEdges = "mean",
) -> Mesh:
    """Read a shape, recognised by content: ICQ text, OBJ or PLY.

    Parameters
    ----------
    path : str or Path
        The file.
    unit : {"km", "m"}
        Unit of an OBJ or PLY, which state none; ICQ is in kilometres.
    faces_from : {1, 0}
        The number of the first vertex in the faces of an OBJ.
    icq_edges : {"mean", "first", "refuse"}
        Treatment of differing labels of one vertex (:meth:`spcola.shape.icq.IcqShape.mesh`).

    Raises
    ------
    FormatError
        If it is none of these, or as raised by their readers.
    InvalidValueError
        If labels of an ICQ differ and `icq_edges` is "refuse".
    """
    form = recognise_shape(path)
    if form == "icq":
        return read_icq(path).mesh(edges=icq_edges)
    if form == "obj":
        return read_obj_mesh(path, unit=unit, faces_from=faces_from)
    return read_ply_mesh(path, unit=unit)
