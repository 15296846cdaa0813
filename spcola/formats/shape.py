"""Shapes in any of the formats that are read, recognised by content."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from spcola.errors import FormatError
from spcola.formats.fortran import is_number
from spcola.formats.icq import read_icq
from spcola.formats.obj import Unit, read_obj
from spcola.formats.ply import read_ply_mesh
from spcola.formats.source import read_bytes
from spcola.mesh import Mesh

ShapeFormat = Literal["icq", "obj", "ply"]

# Comments before the first statement are shorter than this, bytes.
_HEAD = 1 << 20
_OBJ_WORDS = frozenset({"v", "vn", "vt", "vp", "f", "o", "g", "s", "mtllib", "usemtl"})


def recognise_shape(path: str | Path) -> ShapeFormat:
    """Return the format of a shape file, from its first lines.

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


def read_shape(path: str | Path, *, unit: Unit = "km") -> Mesh:
    """Read a shape, recognised by content: ICQ text, OBJ or PLY.

    Parameters
    ----------
    path : str or Path
        The file.
    unit : {"km", "m"}
        Of an OBJ or PLY, which state none; ICQ is in kilometres.

    Raises
    ------
    FormatError
        If it is none of these, or as their readers.
    """
    form = recognise_shape(path)
    if form == "icq":
        return read_icq(path).mesh()
    return read_obj(path, unit=unit) if form == "obj" else read_ply_mesh(path, unit=unit)
