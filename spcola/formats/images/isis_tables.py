"""Tables inside ISIS cubes: pointing, position, rotation of the body, place of the Sun."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spcola.arrays import AnyArray, read_only
from spcola.errors import FormatError
from spcola.formats.images.isis_label import read_gdal_label
from spcola.formats.text import regular_size

# ISIS's types of fields (Text: so many bytes as Size gives).
_TYPES = {"Integer": "i4", "Double": "f8", "Real": "f4", "Text": "S"}
_LARGEST_FIELD = 1 << 20
_ORDERS = {"Lsb": "<", "Msb": ">"}
_LAYOUT = ("Name", "StartByte", "Bytes", "Records", "ByteOrder")


@dataclass(frozen=True, eq=False)
class IsisTable:
    """A table of an ISIS cube.

    Parameters
    ----------
    name : str
        Such as ``InstrumentPointing``.
    columns : mapping of str to ndarray
        Fields in the order of the file: (N,), or (N, Size) where a field has several numbers;
        texts are ``str``. Units are those of ISIS: km, km/s, s past J2000, quaternions.
    keywords : mapping of str to Any
        What the table's label states besides its layout: frames, rotations, kernels.
    """

    name: str
    columns: Mapping[str, AnyArray]
    keywords: Mapping[str, Any]

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))


def read_isis_tables(path: str | Path) -> dict[str, IsisTable]:
    """Read all tables of an ISIS cube.

    Parameters
    ----------
    path : str or Path
        The cube (attached label).

    Returns
    -------
    dict
        Table by name; empty if the cube has none.

    Raises
    ------
    FormatError
        If the label cannot be read, or a table's layout contradicts its size or the file's.
    """
    label = read_gdal_label(path, "ISIS3")
    found = {}
    for key, entry in label.items():
        if key.split("_")[0] == "Table" and isinstance(entry, dict):
            table = _read_table(Path(path), entry)
            found[table.name] = table
    return found


def _read_table(path: Path, entry: Mapping[str, Any]) -> IsisTable:
    """Return one table."""
    name = str(entry.get("Name"))
    where = f"{path}: table {name}"
    start, size, records = (_count(entry, key, where) for key in ("StartByte", "Bytes", "Records"))
    fields = {key: value for key, value in entry.items() if key.startswith("Field_")}
    row = _row_type(list(fields.values()), _ORDERS.get(str(entry.get("ByteOrder"))), where)
    if records < 1 or row.itemsize * records != size:
        raise FormatError(
            f"its label gives {records} records of {row.itemsize} bytes, but {size} bytes", where
        )
    length = regular_size(path)
    if start < 1 or start - 1 + size > length:
        raise FormatError(
            f"lies at bytes {start} to {start + size - 1}, the file has {length}",
            where,
            "the file is truncated; copy it again",
        )
    with path.open("rb") as stream:
        stream.seek(start - 1)
        rows = np.frombuffer(stream.read(size), row)
    keywords = {k: v for k, v in entry.items() if k not in fields and k not in _LAYOUT}
    assert row.names is not None
    return IsisTable(name, {key: _column(rows[key]) for key in row.names}, keywords)


def _row_type(fields: list[Any], order: str | None, where: str) -> np.dtype[np.void]:
    """Return the type of a record."""
    if order is None:
        raise FormatError("its label gives no ByteOrder (Lsb or Msb)", where)
    parts: list[tuple[str, Any]] = []
    for field in fields:
        kind = _TYPES.get(str(field.get("Type")))
        size = _count(field, "Size", where)
        name = str(field.get("Name"))
        if kind is None or not 1 <= size <= _LARGEST_FIELD or name in [part[0] for part in parts]:
            raise FormatError(f"its field {name!r} has no usable name, type and size", where)
        if kind == "S":
            parts.append((name, f"S{size}"))
        else:
            parts.append((name, (order + kind, (size,)) if size > 1 else order + kind))
    if not parts:
        raise FormatError("its label gives no fields", where)
    return np.dtype(parts)


def _column(values: AnyArray) -> AnyArray:
    """Return a column in this machine's byte order, texts as `str`."""
    if values.dtype.kind == "S":
        texts = [v.split(b"\0")[0].decode("latin-1").strip() for v in values.tolist()]
        return read_only(np.array(texts, dtype=str))
    return read_only(values.astype(values.dtype.newbyteorder("=")))


def _count(entry: Mapping[str, Any], key: str, where: str) -> int:
    """Return a whole number of a label."""
    value = entry.get(key)
    if isinstance(value, bool) or not isinstance(value, int):
        raise FormatError(f"its label gives no number for {key} ({value!r})", where)
    return value
