"""Tables that sort in a page without scripts: the order of rows is a matter of style."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fusion.report.layout.html import row_cells

__all__ = ["SORTING_STYLE", "Value", "sortable_table"]

Value = float | str | None
"""What a cell is sorted by; None (or NaN) comes last."""

_MOST_COLUMNS = 14
# Unknown values come after all ranks in both orders, the heading before.
_LAST, _FIRST = 1_000_000, -2_000_000

SORTING_STYLE = f".sortable thead th,.sortable caption{{order:{_FIRST}}}" + "".join(
    f".sortable:has(.{way}{k}:checked) tbody :is(th,td){{order:{order}}}"
    for k in range(_MOST_COLUMNS)
    for way, order in (
        ("up", f"var(--c{k},{_LAST})"),
        ("down", f"calc(0 - var(--c{k},-{_LAST}))"),
    )
)
"""Style sheet of the tables: a row has its rank in each column as a variable, and cells of a grid
are placed by it."""


def sortable_table(
    key: str,
    head: Sequence[str],
    rows: Sequence[Sequence[str]],
    values: Sequence[Sequence[Value]],
    *,
    caption: str = "",
) -> str:
    """Return an HTML table whose columns sort up and down.

    Parameters
    ----------
    key : str
        Identifies the table in the page.
    head : sequence of str
        Headings (HTML), at most fourteen.
    rows : sequence of sequence of str
        Cells (HTML) as of :func:`fusion.report.layout.html_table`, in the order that is seen first.
    values : sequence of sequence of Value
        What each cell is sorted by: of a column all numbers, or all texts.
    caption : str
        HTML.
    """
    ranks = [_ranks([row[k] for row in values]) for k in range(len(head))]
    heads = "".join(
        f'<th>{title}<span class="ways">{_way(key, k, "up")}{_way(key, k, "down")}</span></th>'
        for k, title in enumerate(head)
    )
    body = "".join(
        f'<tr style="{_places([column[number] for column in ranks])}">{row_cells(row)}</tr>'
        for number, row in enumerate(rows)
    )
    title = f"<caption>{caption}</caption>" if caption else ""
    return (
        f'<div class="wide"><table class="sortable" id="{key}" style="--columns:{len(head)}">'
        f"{title}<thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _way(key: str, column: int, way: str) -> str:
    """Return the button that sorts by a column."""
    word, sign = ("ascending", "▲") if way == "up" else ("descending", "▼")
    return (
        f'<label title="{word}"><input type="radio" name="{key}-order" class="{way}{column}" '
        f'aria-label="column {column + 1}, {word}"><span>{sign}</span></label>'
    )


def _ranks(column: Sequence[Value]) -> list[int | None]:
    """Return the rank of each value, from 1; None of unknown ones."""
    unknown = [value is None or (isinstance(value, float) and np.isnan(value)) for value in column]
    known = sorted({value for value, not_ in zip(column, unknown, strict=True) if not not_})  # type: ignore[type-var]
    ranks = {value: number for number, value in enumerate(known, 1)}
    return [None if not_ else ranks[value] for value, not_ in zip(column, unknown, strict=True)]


def _places(ranks: Sequence[int | None]) -> str:
    return ";".join(f"--c{k}:{rank}" for k, rank in enumerate(ranks) if rank is not None)
