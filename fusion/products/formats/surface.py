"""Maplets as triangle meshes: OBJ and PLY.

Vertices are the grid points with a height, row by row; points without one are left out with their
albedo. The two triangles of a cell face along Uz. A cell with a missing corner keeps the triangle
that does not touch it, if the common diagonal does not either.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fusion.products.formats.layers import (
    DESCRIPTIONS,
    frame_text,
    layers_of,
    maplet_of,
    parse_frame,
)
from fusion.products.manifest import Provenance
from spcola import atomic
from spcola.arrays import AnyArray, IntArray
from spcola.errors import FormatError, InvalidValueError
from spcola.formats.shapes.ply import parse_header, read_elements
from spcola.formats.text import KM, read_bytes
from spcola.grids import Maplet, MapletGrid

_FRAME = "spcola frame "
# The comments with the frame and the provenance are shorter than this, bytes.
_HEAD = 1 << 16
_PROVENANCE = "spcola provenance "
_TYPES = {"height": "<f8", "sigma": "<f8", "albedo": "<f8", "count": "<i4", "source": "u1"}
_PLY_NAMES = {"<f8": "double", "<i4": "int", "u1": "uchar"}
_POSITION = [("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("m", "<i4"), ("n", "<i4")]
_FACET = np.dtype([("size", "u1"), ("vertices", "<i4", 3)])


def triangles(maplet: Maplet) -> IntArray:
    """Return the facets (F, 3) over the valid points, which are numbered row by row from 0.

    Raises
    ------
    InvalidValueError
        If no point has a height.
    """
    valid = maplet.valid
    if not valid.any():
        raise InvalidValueError("has no height: there is no surface to write", maplet.name)
    number = np.where(valid, np.cumsum(valid).reshape(valid.shape) - 1, -1)
    # Columns run along Ux and rows along Uy, Ux × Uy = Uz: (m,n) → (m,n+1) → (m+1,n+1) turns left.
    a, b = number[:-1, :-1], number[:-1, 1:]
    d, c = number[1:, :-1], number[1:, 1:]
    facets = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=2).reshape(-1, 3)
    kept: IntArray = facets[(facets >= 0).all(axis=1)]
    return kept


def write_ply(path: str | Path, maplet: Maplet, provenance: Provenance) -> None:
    """Write a maplet as binary PLY in metres, whole or not at all.

    Each vertex has its position (body-fixed, metres), grid indices m and n, and the layers
    height, sigma, albedo and, for a fused maplet, count and source. The comments hold the frame
    and the provenance as JSON.

    Parameters
    ----------
    path : str or Path
    maplet : Maplet
    provenance : Provenance
        What it was made from.

    Raises
    ------
    InvalidValueError
        If no point has a height.
    WorkspaceError
        If the file cannot be written.
    """
    facets = triangles(maplet)
    layers = layers_of(maplet)
    kinds = [*_POSITION, *((name, _TYPES[name]) for name in layers)]
    vertices = np.zeros(int(maplet.valid.sum()), dtype=kinds)
    for letter, values in zip(
        "xyz", np.moveaxis(maplet.points()[maplet.valid], -1, 0), strict=True
    ):
        vertices[letter] = values
    rows, columns = np.nonzero(maplet.valid)
    vertices["m"], vertices["n"] = rows - maplet.grid.half_size, columns - maplet.grid.half_size
    for name, layer in layers.items():
        vertices[name] = layer[maplet.valid]
    faces = np.zeros(len(facets), dtype=_FACET)
    faces["size"], faces["vertices"] = 3, facets
    lines = ["ply", "format binary_little_endian 1.0", "comment unit m"]
    lines += [f"comment {name}: {DESCRIPTIONS[name]}" for name in layers]
    lines += [f"comment {_FRAME}{frame_text(maplet)}", f"comment {_PROVENANCE}{provenance.text()}"]
    lines += [f"element vertex {len(vertices)}"]
    lines += [f"property {_PLY_NAMES[kind]} {name}" for name, kind in kinds]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    header = "\n".join(lines) + "\n"
    atomic.write_bytes(path, header.encode("utf-8") + vertices.tobytes() + faces.tobytes())


def write_obj(path: str | Path, maplet: Maplet, provenance: Provenance) -> None:
    """Write a maplet as OBJ in kilometres (the unit of the field's shapes), whole or not at all.

    OBJ has no further values of a vertex: they follow it in a comment,
    ``#p m n height sigma albedo [count source]``, which other readers skip.

    Parameters
    ----------
    path : str or Path
    maplet : Maplet
    provenance : Provenance
        What it was made from.

    Raises
    ------
    InvalidValueError
        If no point has a height.
    WorkspaceError
        If the file cannot be written.
    """
    facets = triangles(maplet) + 1
    layers = layers_of(maplet)
    rows, columns = np.nonzero(maplet.valid)
    q = maplet.grid.half_size
    known = zip(*(layer[maplet.valid].tolist() for layer in layers.values()), strict=True)
    lines = ["# unit of v: km", f"# #p m n {' '.join(layers)} (m)"]
    lines += [f"# {_FRAME}{frame_text(maplet)}", f"# {_PROVENANCE}{provenance.text()}"]
    points_km = (maplet.points()[maplet.valid] / KM).tolist()
    places = zip((rows - q).tolist(), (columns - q).tolist(), strict=True)
    for (x, y, z), (m, n), values in zip(points_km, places, known, strict=True):
        lines.append(f"v {x:.12f} {y:.12f} {z:.12f}\n#p {m} {n} {' '.join(map(repr, values))}")
    lines += [f"f {a} {b} {c}" for a, b, c in facets.tolist()]
    atomic.write_bytes(path, ("\n".join(lines) + "\n").encode("utf-8"))


def is_surface(path: str | Path) -> bool:
    """Return whether an OBJ or PLY holds the frame of a maplet: whether it was written here.

    Parameters
    ----------
    path : str or Path
    """
    return _FRAME.encode() in read_bytes(path, most=_HEAD)


def read_surface(path: str | Path) -> Maplet:
    """Read an OBJ or PLY that this module wrote: a bit-identical maplet.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        If it is neither, is cut off, or its vertices do not fit its frame.
    """
    content = read_bytes(path)
    try:
        if content.startswith(b"ply\n"):
            frame, columns = _ply_vertices(content, path)
        else:
            frame, columns = _obj_vertices(content.decode("utf-8"), path)
    except UnicodeDecodeError as error:
        raise FormatError("is neither PLY nor text", path) from error
    name, grid, center_sigma = parse_frame(frame, f"{path}: frame")
    try:
        return maplet_of(name, grid, _on_grid(grid, columns, path), center_sigma)
    except InvalidValueError as error:
        raise FormatError(str(error), path) from error


def _ply_vertices(content: bytes, path: str | Path) -> tuple[str, dict[str, AnyArray]]:
    """Return the frame's JSON and the vertex properties of a PLY of this module."""
    header = parse_header(content, path)
    frame = _comment(header.comments, _FRAME, path)
    vertex = header.element("vertex")
    types = {name: kind.lstrip("<") for name, kind in (*_POSITION, *_TYPES.items())}
    stated = {} if vertex is None else {one.name: one.kind for one in vertex.properties}
    if not stated or any(types.get(name) != kind for name, kind in stated.items()):
        raise FormatError("has vertices that are not those of a maplet", path)
    return frame, read_elements(content, header, path)["vertex"]


def _obj_vertices(text: str, path: str | Path) -> tuple[str, dict[str, AnyArray]]:
    """Return the frame's JSON and the values in comments of an OBJ of this module."""
    lines = text.splitlines()
    frame = _comment(lines, f"# {_FRAME}", path)
    titles = _comment(lines, "# #p ", path).removesuffix(" (m)").split()
    rows = []
    for number, line in enumerate(lines, start=1):
        if line.startswith("#p "):
            fields = line.split()[1:]
            try:
                rows.append([float(field) for field in fields])
            except ValueError as error:
                raise FormatError("holds no numbers", f"{path}: line {number}") from error
            if len(fields) != len(titles):
                raise FormatError(f"has not {len(titles)} numbers", f"{path}: line {number}")
    if len(rows) != sum(line.startswith("v ") for line in lines):
        raise FormatError("has vertices without a #p line, or is cut off", path)
    table = np.array(rows, dtype=np.float64).reshape(-1, len(titles))
    return frame, dict(zip(titles, table.T, strict=True))


def _on_grid(
    grid: MapletGrid, columns: dict[str, AnyArray], path: str | Path
) -> dict[str, AnyArray]:
    """Return the values of the vertices as layers on the grid."""
    if not {"m", "n", "height", "sigma", "albedo"} <= set(columns):
        raise FormatError("lacks a property of a maplet's vertices", path)
    rows = columns["m"].astype(np.int64) + grid.half_size
    places = columns["n"].astype(np.int64) + grid.half_size
    inside = (rows >= 0) & (rows < grid.size) & (places >= 0) & (places < grid.size)
    if not inside.all() or len(set(zip(rows.tolist(), places.tolist(), strict=True))) < len(rows):
        raise FormatError("has a vertex outside its grid, or two at one grid point", path)
    empty = {"height": np.nan, "sigma": np.nan, "albedo": 1.0, "count": 0, "source": 0}
    layers: dict[str, AnyArray] = {}
    for name in _TYPES:
        if name in columns:
            layers[name] = np.full(grid.shape, empty[name])
            layers[name][rows, places] = columns[name]
    return layers


def _comment(lines: Sequence[str], start: str, path: str | Path) -> str:
    """Return what follows `start` in the first line that begins with it."""
    for line in lines:
        if line.startswith(start):
            return line.removeprefix(start)
    raise FormatError(f"has no line {start.strip()!r}: it was not written by spcola", path)
