"""Results as tables: columns for JSON, CSV, Arrow and Parquet."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from fusion.pipeline.catalog import read_records
from fusion.runtime import json_value
from fusion.stages.ingest import readable_scans, scan_facts
from fusion.workspace import Workspace
from spcola.errors import SpcolaError, WorkspaceError

__all__ = ["Table", "TableFormat", "read_table", "table_names"]

_AXES = ("x", "y", "z")


class TableFormat(StrEnum):
    """How a table is written, by its media type."""

    JSON = "application/json"
    CSV = "text/csv"
    ARROW = "application/vnd.apache.arrow.stream"
    PARQUET = "application/vnd.apache.parquet"


@dataclass(frozen=True)
class Table:
    """Columns of equal length.

    Attributes
    ----------
    name : str
    columns : mapping of str to sequence
        Texts, numbers or truth values; None where unknown.
    """

    name: str
    columns: Mapping[str, Sequence[Any]]

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def as_bytes(self, form: TableFormat) -> bytes:
        """Return the table as a file or a stream of the format `form`.

        Raises
        ------
        SpcolaError
            If the library that writes it is not installed.
        """
        return _WRITERS[form](self)


def table_names(workspace: Workspace) -> list[str]:
    """Return the names of the tables of a `workspace` whose results are there."""
    content = {
        name: workspace.find_json(path.name) or {}
        for name, path in (
            ("registration", workspace.registration_path), ("scale", workspace.scale_path)
        )
    }  # fmt: skip
    found = [name for name, (result, key) in _LISTS.items() if content[result].get(key)]
    return sorted([*found, *_MADE])


def read_table(workspace: Workspace, name: str) -> Table:
    """Return a table.

    Vectors become three columns ``_x``, ``_y`` and ``_z``; other lists and mappings one column for
    each entry.

    Parameters
    ----------
    workspace : Workspace
    name : str
        One of :func:`table_names`.

    Raises
    ------
    WorkspaceError
        If there is no such table.
    """
    if name in _MADE:
        return table_of(name, _MADE[name](workspace))
    if name not in _LISTS:
        do = f"there are: {', '.join(table_names(workspace))}"
        raise WorkspaceError(f"there is no table {name!r}", workspace.root, do)
    result, key = _LISTS[name]
    content = workspace.find_json(f"{result}.json")
    rows = None if content is None else content.get(key)
    if rows is None:
        where = workspace.home / f"{result}.json"
        raise WorkspaceError(f"there is no {key} for the table {name!r}", where)
    return table_of(name, rows)


def table_of(name: str, rows: Iterable[Mapping[str, Any]]) -> Table:
    """Make a table of JSON objects; None where one lacks a key of others.

    Parameters
    ----------
    name : str
    rows : iterable of mappings
    """
    flat = [_flat(row) for row in rows]
    keys = dict.fromkeys(key for row in flat for key in row)
    return Table(name, {key: [row.get(key) for row in flat] for key in keys})


def _flat(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return an object without objects and lists in it."""
    found: dict[str, Any] = {}
    for key, value in json_value(row).items():
        if isinstance(value, dict):
            found |= {f"{key}.{inner}": part for inner, part in _flat(value).items()}
        elif isinstance(value, list):
            names = _AXES if len(value) == len(_AXES) else [str(k) for k in range(len(value))]
            parts = {f"{key}_{name}": part for name, part in zip(names, value, strict=True)}
            found |= _flat(parts)
        else:
            found[key] = value
    return found


def _findings(workspace: Workspace) -> list[dict[str, Any]]:
    return [
        {"stage": record.stage, **finding}
        for record in read_records(workspace)
        for finding in record.summary.get("findings") or []
    ]


def _scans(workspace: Workspace) -> list[dict[str, Any]]:
    facts = [scan_facts(scan) for scan in readable_scans(workspace).values()]
    return [{key: each[key] for key in each if key != "rejected"} for each in facts]


_LISTS = {
    "registration-mapolas": ("registration", "per_mapola"),
    "registration-scans": ("registration", "per_scan"),
    "registration-scan-fits": ("registration", "per_scan_fit"),
    "scale-days": ("scale", "per_day"),
    "scale-pairs": ("scale", "per_pair"),
    "scale-shots": ("scale", "per_shot"),
}
"""Tables that are lists of a result: its name and the key."""
_MADE: Mapping[str, Callable[[Workspace], list[dict[str, Any]]]] = {
    "findings": _findings,
    "scans": _scans,
}


def _json(table: Table) -> bytes:
    content = {"name": table.name, "rows": len(table), "columns": json_value(table.columns)}
    return (json.dumps(content) + "\n").encode()


def _csv(table: Table) -> bytes:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\r\n")
    writer.writerow(table.columns)
    writer.writerows(zip(*table.columns.values(), strict=True))
    return stream.getvalue().encode()


def _arrow_table(table: Table) -> Any:
    """Return the table as one of Arrow; a column of several types becomes text."""
    try:
        import pyarrow  # noqa: PLC0415
    except ImportError as error:
        do = "install pyarrow, or ask for CSV or JSON"
        raise SpcolaError("Arrow and Parquet need the package pyarrow", do=do) from error

    def column(values: Sequence[Any]) -> Any:
        kinds = {type(value) for value in values if value is not None}
        if kinds == {int, float}:
            return pyarrow.array(values, pyarrow.float64())
        if len(kinds) > 1:
            values = [None if value is None else str(value) for value in values]
        return pyarrow.array(values)

    return pyarrow.table({key: column(values) for key, values in table.columns.items()})


def _arrow(table: Table) -> bytes:
    content = _arrow_table(table)
    import pyarrow  # noqa: PLC0415

    sink = pyarrow.BufferOutputStream()
    with pyarrow.ipc.new_stream(sink, content.schema) as writer:
        writer.write_table(content)
    return sink.getvalue().to_pybytes()


def _parquet(table: Table) -> bytes:
    content = _arrow_table(table)
    import pyarrow.parquet  # noqa: PLC0415

    sink = pyarrow.BufferOutputStream()
    pyarrow.parquet.write_table(content, sink)
    return sink.getvalue().to_pybytes()


_WRITERS: Mapping[TableFormat, Callable[[Table], bytes]] = {
    TableFormat.JSON: _json,
    TableFormat.CSV: _csv,
    TableFormat.ARROW: _arrow,
    TableFormat.PARQUET: _parquet,
}
