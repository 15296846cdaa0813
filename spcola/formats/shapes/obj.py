"""Shapes as Wavefront OBJ text: vertices and faces."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from spcola import atomic
from spcola.arrays import AnyArray, FloatArray, IntArray
from spcola.errors import FormatError
from spcola.formats.shapes.icq import check_radius
from spcola.formats.text.source import KM, read_text_bytes
from spcola.formats.text.table import NumberRows, parse_rows
from spcola.shape import Mesh

Unit = Literal["km", "m"]
FacesFrom = Literal[1, 0]

METRES: dict[Unit, float] = {"km": KM, "m": 1.0}
"""Metres in the unit of a file that does not state its own."""

_IGNORED = frozenset(b"mtllib usemtl usemap maplib bevel c_interp d_interp lod".split())
_LETTERS = np.frombuffer(b"vfogslp", np.uint8)
_AFTER_V = np.frombuffer(b"tnp", np.uint8)
_AFTER_SLASH = np.frombuffer(b"0123456789-+/", np.uint8)
_END, _BLANK, _SLASH = ord("\n"), ord(" "), ord("/")


def read_obj_mesh(path: str | Path, *, unit: Unit = "km", faces_from: FacesFrom = 1) -> Mesh:
    """Read an OBJ shape: ``v`` and ``f`` lines; texture, normals, groups and materials are ignored.

    Faces may count from the end (negative indices) and may have the forms ``v``, ``v/vt``,
    ``v//vn`` and ``v/vt/vn``. Polygons are cut into triangles that share their first corner.

    Parameters
    ----------
    path : str or Path
        The file.
    unit : {"km", "m"}
        Unit of the coordinates: OBJ has none; kilometres are the practice of SPC.
    faces_from : {1, 0}
        The number of the first vertex: 1 in OBJ, 0 in files of programs that confuse it with PLY.

    Raises
    ------
    FormatError
        If a word is no number, a face names a vertex that does not exist, a statement is unknown,
        or there is no vertex or face; with its line.
    """
    statements = _Statements(read_text_bytes(path), Path(path))
    vertices = statements.rows(b"v")
    if not len(vertices.counts):
        raise FormatError("holds no vertex", path, "is it an OBJ file?")
    table = vertices.table((3, 4, 6, 7), "a vertex")[:, :3]
    check_radius(vertices, table, METRES[unit])
    faces = statements.rows(b"f")
    if not len(faces.counts):
        raise FormatError("holds no face", path, "is it an OBJ file?")
    facets = _triangles(faces, vertices.lines, faces_from)
    return Mesh(table * METRES[unit], facets, Path(path).stem)


def write_obj_mesh(path: str | Path, mesh: Mesh, *, unit: Unit = "km") -> None:
    """Write an OBJ shape; the vertices are written so that reading gives the same doubles.

    Parameters
    ----------
    path : str or Path
        Written whole or not at all.
    mesh : Mesh
        Its name and the unit are written as a comment.
    unit : {"km", "m"}
        Unit of the coordinates.

    Raises
    ------
    WorkspaceError
        If the file cannot be written.
    """
    name = " ".join(mesh.name.split())
    lines = [f"# {name}: {len(mesh.vertices)} vertices, {len(mesh.facets)} facets, in {unit}\n"]
    scaled = divided(mesh.vertices, METRES[unit])
    lines += [f"v {x!r} {y!r} {z!r}\n" for x, y, z in scaled.tolist()]
    lines += [f"f {a} {b} {c}\n" for a, b, c in (mesh.facets + 1).tolist()]
    atomic.write_text(path, "".join(lines))


def divided(values: FloatArray, unit: float) -> FloatArray:
    """Return `values` / `unit`, each changed by a last bit where that makes it multiply back."""
    result: FloatArray = values / unit
    for side in (-np.inf, np.inf):
        near = np.nextafter(result, side)
        result = np.where((result * unit != values) & (near * unit == values), near, result)
    return result


class _Statements:
    """The lines of an OBJ file, by their first word (all at once: files are large)."""

    def __init__(self, content: bytes, path: Path) -> None:
        self.path = path
        self.text = np.frombuffer(content + b"\n", np.uint8)
        ends = np.flatnonzero(self.text == _END)
        self.lengths = np.diff(ends, prepend=-1)
        self.first = _first_words(self.text, ends - self.lengths + 1, ends)
        second = self.text[np.minimum(self.first + 1, len(self.text) - 1)]
        self.letter = np.where(second <= _BLANK, self.text[self.first], 0)
        known = (self.first == ends) | (self.text[self.first] == ord("#"))
        known |= (self.text[self.first] == ord("v")) & np.isin(second, _AFTER_V)
        known |= np.isin(self.letter, _LETTERS)
        for line in np.flatnonzero(~known):
            word = self.text[self.first[line] : ends[line]].tobytes().split()[0]
            if word not in _IGNORED:
                name = word[:20].decode("ascii", errors="replace")
                raise FormatError(f"{name!r} is no statement of OBJ", f"{path}, line {line + 1}")

    def rows(self, letter: bytes) -> NumberRows:
        """Return the numbers after the statements `letter`; of ``v/vt/vn`` only the first."""
        chosen = self.letter == ord(letter)
        text = self.text.copy()
        text[self.first[chosen]] = _BLANK
        part = text[np.repeat(chosen, self.lengths)]
        lines = np.flatnonzero(chosen) + 1
        if letter == b"f" and np.any(part == _SLASH):
            part = _without_slashes(part, lines, self.path)
        return parse_rows(part.tobytes(), self.path, lines=lines)


def _first_words(text: AnyArray, begins: IntArray, ends: IntArray) -> IntArray:
    """Return where the first word of each line begins; the line's end if it has none."""
    first = begins.copy()
    indented = np.flatnonzero(first < ends)
    while len(indented := indented[text[first[indented]] <= _BLANK]):
        first[indented] += 1
        indented = indented[first[indented] < ends[indented]]
    return first


def _without_slashes(text: AnyArray, lines: IntArray, path: Path) -> AnyArray:
    """Blank words from their first slash on (indices of texture and normals)."""
    index = np.arange(len(text))
    slash = np.maximum.accumulate(np.where(text == _SLASH, index, -1))
    blank = np.maximum.accumulate(np.where(text <= _BLANK, index, -1))
    dropped = slash > blank
    odd = np.flatnonzero(dropped & ~np.isin(text, _AFTER_SLASH))
    if len(odd):
        line = lines[np.count_nonzero(text[: odd[0]] == _END)]
        raise FormatError("a face has an index that is no whole number", f"{path}, line {line}")
    return np.where(dropped, _BLANK, text).astype(np.uint8)


def _triangles(faces: NumberRows, vertex_lines: IntArray, faces_from: FacesFrom) -> IntArray:
    """Return the triangles (F, 3), vertices from 0, of polygons given by counts from 1 or −1.

    Or from 0, where `faces_from` is 0.
    """
    if np.any(faces.counts < 3):
        row = int(np.flatnonzero(faces.counts < 3)[0])
        faces.fail(row, f"a face needs at least 3 vertices, not {faces.counts[row]}")
    owner = np.repeat(np.arange(len(faces.counts)), faces.counts)
    before = np.searchsorted(vertex_lines, faces.lines)
    forward = faces.values >= faces_from
    index = np.where(forward, faces.values - faces_from, faces.values + before[owner])
    whole = (faces.values == np.rint(faces.values)) & (forward | (faces.values < 0))
    bad = np.flatnonzero(~whole | (index < 0) | (index >= len(vertex_lines)))
    if len(bad):
        none = np.any(faces.values == 0) and faces.values.max() < len(vertex_lines)
        if faces_from == 1 and none:
            faces.fail(
                int(owner[bad[0]]),
                "a face names vertex 0: its faces count from 0, those of an OBJ from 1",
                "read it with --faces-from 0, in a workspace with [body] faces_from = 0",
            )
        faces.fail(
            int(owner[bad[0]]),
            f"a face names vertex {faces.values[bad[0]]:g}, the file has {len(vertex_lines)}",
        )
    if faces_from == 0 and not np.any(index == 0):
        faces.fail(0, "no face names vertex 0: its faces count from 1", "leave --faces-from out")
    return fan(index.astype(np.int64), faces.counts)


def fan(indices: IntArray, counts: IntArray) -> IntArray:
    """Cut polygons into triangles (F, 3) that share their first corner.

    Parameters
    ----------
    indices : (N,) ndarray of int
        Corners of all polygons, one after the other.
    counts : (P,) ndarray of int
        Corners of each, at least 3.
    """
    begins = np.cumsum(counts) - counts
    pieces = counts - 2
    polygon = np.repeat(np.arange(len(counts)), pieces)
    step = np.arange(len(polygon)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    second = begins[polygon] + step + 1
    return np.stack([indices[begins[polygon]], indices[second], indices[second + 1]], axis=1)
