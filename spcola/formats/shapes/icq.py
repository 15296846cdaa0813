"""ICQ shapes as SPC text: Q, then the vertices of six faces in kilometres."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from spcola import atomic
from spcola.arrays import FloatArray, check_finite
from spcola.errors import FormatError
from spcola.formats.text.source import KM, LARGEST_RADIUS_KM, read_text_bytes
from spcola.formats.text.table import NumberRows, parse_rows
from spcola.shape.icq import IcqShape, first_open_edge, label_name


def read_icq(path: str | Path) -> IcqShape:
    """Read the ICQ text at `path`: Q, then x y z (km) for F = 1 … 6, J and I = 0 … Q (I fastest).

    Labels are unchanged, also those of one vertex. A fourth column (relative albedo, or sigma in
    metres in SIGMA.TXT) becomes the layer.


    Raises
    ------
    FormatError
        If a word is no number, a line has another count than the first, the number of lines
        contradicts Q, a vertex is further than 1e5 km or two labels of one vertex lie apart by
        more than a hundredth of the largest radius.
    """
    rows = parse_rows(read_text_bytes(path), path).without_blank_lines()
    if not len(rows.counts):
        raise FormatError("holds no number", path)
    head, body = rows.split(1)
    q_value = float(head.table((1,), "the first line (Q)")[0, 0])
    if q_value != int(q_value) or q_value < 1:
        head.fail(0, f"Q must be a whole number above 0, not {q_value:g}")
    q = int(q_value)
    wanted = 6 * (q + 1) ** 2
    if len(body.counts) != wanted:
        problem = "is truncated" if len(body.counts) < wanted else "is too long"
        rows.fail(
            -1,
            f"Q = {q} needs {wanted} vertices, the file has {len(body.counts)}: it {problem}, "
            "or Q is mis-declared",
        )
    table = body.table((3, 4), "a vertex")
    check_radius(body, table[:, :3], KM)
    layer = table[:, 3].reshape(6, q + 1, q + 1) if table.shape[1] == 4 else None
    vertices = KM * table[:, :3].reshape(6, q + 1, q + 1, 3)
    apart = first_open_edge(vertices)
    if apart is not None:
        body.fail(
            apart[1],
            f"label {label_name(apart[1], q)} names the vertex of label "
            f"{label_name(apart[0], q)} on line {body.lines[apart[0]]}, but lies apart from it by "
            "more than 1% of the largest radius",
            "are its labels in another order?",
        )
    return IcqShape(vertices, layer, Path(path).stem)


def write_icq(path: str | Path, shape: IcqShape, *, digits: int = 5) -> None:
    """Write an ICQ text file.

    Parameters
    ----------
    path : str or Path
        Written whole or not at all; kilometres inside.
    shape : IcqShape
        Its layer, if any, becomes the fourth column.
    digits : int
        Decimals of the mantissa; SPC writes five (1 mm at a radius of 100 m … 1 km).

    Raises
    ------
    InvalidValueError
        If the layer contains a value that is not finite.
    WorkspaceError
        If the file cannot be written.
    """
    columns = shape.vertices.reshape(-1, 3) / KM
    if shape.layer is not None:
        check_finite(shape.layer, f"{shape.name}: layer")
        columns = np.column_stack([columns, shape.layer.ravel()])
    form = f"%{digits + 8}.{digits}E" * columns.shape[1] + "\n"
    body = (form * len(columns)) % tuple(columns.ravel().tolist())
    atomic.write_text(path, f"{shape.q:12d}\n" + body.replace("E", "D"))


def check_radius(rows: NumberRows, table: FloatArray, metres: float) -> None:
    """Check that a table (N, 3) of vertices, in units of `metres`, fits a small body.

    Raises
    ------
    FormatError
        With the line of the first that is further than 1e5 km from the origin.
    """
    far = np.flatnonzero(np.linalg.norm(table, axis=1) * metres > LARGEST_RADIUS_KM * KM)
    if len(far):
        rows.fail(
            int(far[0]),
            f"the vertex is more than {LARGEST_RADIUS_KM:g} km from the body's centre",
            "is it in another unit?",
        )
