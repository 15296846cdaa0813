"""Meshes as PLY: ascii, or binary in either byte order."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from spcola import atomic
from spcola.arrays import AnyArray, FloatArray, IntArray, check_shape
from spcola.errors import FormatError, InvalidValueError
from spcola.formats.shapes.obj import METRES, Unit, divided, fan
from spcola.formats.shapes.ply.data import PlyValues, read_elements
from spcola.formats.shapes.ply.header import Encoding, parse_header
from spcola.formats.text.source import KM, LARGEST_RADIUS_KM, read_bytes
from spcola.shape import Mesh

_FACE_LISTS = ("vertex_indices", "vertex_index")
_FORMATS: dict[Encoding, str] = {
    "ascii": "ascii",
    "little": "binary_little_endian",
    "big": "binary_big_endian",
}


def read_ply_mesh(path: str | Path, *, unit: Unit = "km") -> Mesh:
    """Read a PLY mesh; further numbers of its vertices are ignored.

    Parameters
    ----------
    path : str or Path
        The file: ascii, or binary in either byte order.
    unit : {"km", "m"}
        Unit of the coordinates: PLY has none.

    Raises
    ------
    FormatError
        If the header is wrong, the data end early or go on, or a number is absurd; with the line
        (header, ascii data) or the element.
    """
    content = read_bytes(path)
    elements = read_elements(content, parse_header(content, path), path)
    vertices = _vertices(elements, path, METRES[unit])
    facets = _facets(elements, len(vertices), path)
    return Mesh(vertices, facets, Path(path).stem)


def write_ply_mesh(
    path: str | Path,
    mesh: Mesh,
    *,
    unit: Unit = "km",
    encoding: Encoding = "little",
    layers: Mapping[str, AnyArray] | None = None,
) -> None:
    """Write a mesh as PLY, coordinates as doubles.

    Parameters
    ----------
    path : str or Path
        Written whole or not at all.
    mesh : Mesh
        Metres; its name and the unit are written as a comment.
    unit : {"km", "m"}
        Unit of the coordinates in the file.
    encoding : {"little", "big", "ascii"}
        Byte order, or text.
    layers : mapping of str to (V,) ndarray, optional
        More numbers for each vertex, stored as they are (float64).

    Raises
    ------
    InvalidValueError
        If a layer has another length, or a name that is taken or no word.
    WorkspaceError
        If the file cannot be written.
    """
    layers = dict(layers or {})
    for name, values in layers.items():
        check_shape(np.asarray(values), (len(mesh.vertices),), f"layer {name}")
        if not (name.isascii() and name.isidentifier()) or name in ("x", "y", "z"):
            raise InvalidValueError("is no name for a PLY property", f"layer {name!r}")
    scaled = divided(mesh.vertices, METRES[unit])
    columns = np.column_stack([scaled, *layers.values()]) if layers else scaled
    head = _header(mesh, unit, encoding, tuple(layers))
    if encoding == "ascii":
        rows = "".join(" ".join(map(repr, row)) + "\n" for row in columns.tolist())
        faces = "".join(f"3 {a} {b} {c}\n" for a, b, c in mesh.facets.tolist())
        atomic.write_text(path, f"{head}{rows}{faces}")
        return
    order = "<" if encoding == "little" else ">"
    records = np.zeros(len(mesh.facets), [("count", "u1"), ("corner", order + "i4", 3)])
    records["count"] = 3
    records["corner"] = mesh.facets
    data = columns.astype(order + "f8").tobytes() + records.tobytes()
    atomic.write_bytes(path, head.encode("ascii") + data)


def _header(mesh: Mesh, unit: Unit, encoding: Encoding, layers: tuple[str, ...]) -> str:
    """Return the header of the file of `mesh`."""
    name = " ".join(mesh.name.split()).encode("ascii", errors="replace").decode("ascii")
    lines = [
        "ply",
        f"format {_FORMATS[encoding]} 1.0",
        f"comment {name}, in {unit}",
        f"element vertex {len(mesh.vertices)}",
        *(f"property double {column}" for column in ("x", "y", "z", *layers)),
        f"element face {len(mesh.facets)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    return "\n".join(lines) + "\n"


def _vertices(elements: dict[str, PlyValues], path: str | Path, metres: float) -> FloatArray:
    """Return the vertices (V, 3), metres."""
    columns = [elements.get("vertex", {}).get(name) for name in ("x", "y", "z")]
    if any(column is None for column in columns):
        raise FormatError("has no element 'vertex' with x, y and z", path)
    table = np.column_stack([np.asarray(column, dtype=np.float64) for column in columns])
    largest = LARGEST_RADIUS_KM * KM / metres
    far = np.flatnonzero(~np.all(np.abs(table) <= largest, axis=1))
    if len(far):
        raise FormatError(
            f"the vertex is not finite or more than {LARGEST_RADIUS_KM:g} km from the centre",
            f"{path}, vertex {far[0]}",
            "is it in another unit or byte order?",
        )
    return table * metres


def _facets(elements: dict[str, PlyValues], vertex_count: int, path: str | Path) -> IntArray:
    """Return the triangles (F, 3), polygons cut into fans."""
    faces = elements.get("face", {})
    name = next((name for name in _FACE_LISTS if name in faces), None)
    if name is None or not len(faces[name]):
        raise FormatError("holds no face", path, "is it a point cloud?")
    counts = faces[f"{name}.count"].astype(np.int64)
    corners = faces[name].astype(np.float64)
    owner = np.repeat(np.arange(len(counts)), counts)
    wrong = (corners < 0) | (corners >= vertex_count) | (corners != np.rint(corners))
    bad = np.concatenate([np.flatnonzero(counts < 3), owner[wrong]])
    if len(bad):
        raise FormatError(
            f"has fewer than 3 corners or names a vertex that does not exist ({vertex_count} do)",
            f"{path}, face {int(bad.min())}",
        )
    return fan(corners.astype(np.int64), counts)
