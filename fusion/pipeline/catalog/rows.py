"""Rows of the catalogue: their checksums, and the digest of a file that a row states."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Any

from fusion.runtime.folders import may_hide_a_change

CATALOG_FILE = "catalog.sqlite"
FileStatus = tuple[int, int, int, int]
"""Size, times of modification and of status change (ns since 1970), inode."""


def with_checksum(*fields: Any) -> tuple[Any, ...]:
    """Return the fields of a row followed by their checksum."""
    text = "\0".join(str(field) for field in fields)
    return (*fields, hashlib.sha256(text.encode("utf-8", "surrogateescape")).hexdigest())


def known_digest(row: Sequence[Any], name: str, state: FileStatus) -> str | None:
    """Return the digest that a row states of a file in this state; None if it states none."""
    if tuple(row[:5]) != (name, *state) or tuple(row) != with_checksum(*row[:-1]):
        return None
    return None if may_hide_a_change(state[2], since=row[5]) else str(row[6])
