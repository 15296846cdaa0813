"""Findings for people: a code, what it is about, what to do."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

__all__ = ["finding_lines", "first_names"]

_MOST = 5


def first_names(names: Sequence[str], most: int = _MOST) -> str:
    """Return the first names, and how many more there are.

    Parameters
    ----------
    names : sequence of str
    most : int
    """
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")


def finding_lines(findings: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return a line for each finding in JSON types.

    Parameters
    ----------
    findings : iterable of mapping
        With a `code`, the `names` that it is about, and what to `do`.
    """
    return [f"  {one['code']}: {first_names(one['names'])}; {one['do']}" for one in findings]
