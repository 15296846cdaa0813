"""Bytes of answers as arrays and tables."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np

from spcola.arrays import AnyArray, FloatArray, IntArray

if TYPE_CHECKING:
    import pyarrow as pa

ARROW = "application/vnd.apache.arrow.stream"
JSON = "application/json"


def has_arrow() -> bool:
    """Return whether pyarrow is installed."""
    return find_spec("pyarrow") is not None


def arrow_table(content: bytes) -> pa.Table:
    """Return the table of an Arrow stream."""
    from pyarrow import ipc  # noqa: PLC0415

    with ipc.open_stream(content) as reader:
        return reader.read_all()


def columns_of(content: Mapping[str, Any]) -> dict[str, AnyArray]:
    """Return the columns of a table in JSON; numbers that are unknown are NaN, texts None."""
    columns: Mapping[str, Sequence[Any]] = content["columns"]
    return {name: _column(values) for name, values in columns.items()}


def _column(values: Sequence[Any]) -> AnyArray:
    known = [value for value in values if value is not None]
    if all(isinstance(value, bool) for value in known) and len(known) == len(values):
        return np.array(values, dtype=bool)
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in known):
        whole = len(known) == len(values) and all(isinstance(value, int) for value in known)
        return np.array(values, dtype=np.int64 if whole and known else np.float64)
    return np.array(values, dtype=object)


def mesh_of(content: bytes) -> tuple[FloatArray, IntArray]:
    """Return vertices (V, 3), metres, and faces (F, 3) of the bytes of a shape."""
    length = int(np.frombuffer(content, "<u4", 1)[0])
    header = json.loads(content[4 : 4 + length])
    vertices = np.frombuffer(content, "<f4", 3 * header["vertices"], 4 + length).reshape(-1, 3)
    begin = 4 + length + vertices.nbytes
    faces = np.frombuffer(content, "<u4", 3 * header["faces"], begin).reshape(-1, 3)
    return vertices + np.array(header["center_m"]), faces.astype(np.int64)
