"""Elements of the report's pages: numbers, tables, figures, and the page itself."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fusion.report.layout.figures import figure_bytes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TEXT_CELL, MARKED_CELL = "\x00", "\x01"
"""Marks at the start of a table's cell: text, and a highlighted number."""


def number_text(value: Any, sigma: Any = None) -> str:
    """Return a number to two digits of its sigma, or to six digits; a dash where unknown."""
    if value is None or (isinstance(value, float) and not np.isfinite(value)):
        return "–"
    if isinstance(value, str | bool | int):
        return escape(str(value))
    if sigma is None or not np.isfinite(sigma) or sigma <= 0:
        return f"{value:.6g}".replace("-", "−")
    decimals = max(0, 1 - int(np.floor(np.log10(sigma))))
    return (f"{value:.{decimals}f}" if decimals <= 9 else f"{value:.3e}").replace("-", "−")


def html_table(head: Sequence[str], rows: Iterable[Sequence[str]], *, caption: str = "") -> str:
    """Return an HTML table; the first cell of each row is its heading. Cells are HTML."""
    title = f"<caption>{caption}</caption>" if caption else ""
    heads = "".join(f"<th>{cell}</th>" for cell in head)
    body = "".join(f"<tr>{row_cells(row)}</tr>" for row in rows)
    return (
        f'<div class="wide"><table>{title}<thead><tr>{heads}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def row_cells(row: Sequence[str]) -> str:
    """Return the cells of a row of a table; the first one is its heading. Cells are HTML."""
    return f"<th>{row[0]}</th>{''.join(map(_cell, row[1:]))}"


def _cell(cell: str) -> str:
    """Return one cell; a leading mark selects text, or a highlighted number."""
    if cell.startswith(TEXT_CELL):
        return f'<td class="text">{cell[1:]}</td>'
    if cell.startswith(MARKED_CELL):
        return f'<td class="off">{cell[1:]}</td>'
    return f"<td>{cell}</td>"


def html_list(heading: str, items: Iterable[str]) -> str:
    """Return a heading over a list of plain texts (HTML); "" if there is none."""
    listed = "".join(f"<li>{escape(item)}</li>" for item in items)
    return f'<h3>{heading}</h3><ul class="reasons">{listed}</ul>' if listed else ""


def data_uri(figure: Figure, kind: Literal["png", "svg"] = "svg") -> str:
    """Return the figure as a data URI; equal figures give equal text."""
    mime = "image/svg+xml" if kind == "svg" else "image/png"
    return f"data:{mime};base64,{base64.b64encode(figure_bytes(figure, kind)).decode('ascii')}"


def html_figure(
    figure: Figure, caption: str, alternative: str, kind: Literal["png", "svg"] = "svg"
) -> str:
    """Return the element of a page that shows a figure above its caption (HTML)."""
    return (
        f'<figure><img alt="{escape(alternative)}" src="{data_uri(figure, kind)}">'
        f"<figcaption>{caption}</figcaption></figure>"
    )


def html_page(
    title: str,
    heading: str,
    sections: Sequence[tuple[str, str, str]],
    versions: Mapping[str, str],
    *,
    preface: str = "",
    style: str = "",
) -> str:
    """Return a self-contained page: everything it shows is inside.

    Parameters
    ----------
    title, heading : str
        Plain text, of the browser's window and of the page.
    sections : sequence of (str, str, str)
        Identifier, title (plain text) and content (HTML) of each.
    versions : mapping of str to str
        Programs and their versions, for the footer.
    preface : str
        HTML before the first section.
    style : str
        Style besides that of all pages.
    """
    links = "".join(f'<a href="#{key}">{escape(name)}</a>' for key, name, _ in sections)
    body = "".join(
        f'<section id="{key}"><h2>{escape(name)}</h2>{content}</section>'
        for key, name, content in sections
    )
    style = files("fusion.report").joinpath("report.css").read_text(encoding="utf-8") + style
    made = ", ".join(f"{key} {value}" for key, value in versions.items())
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{style}</style></head><body>"
        f"<header><h1>{escape(heading)}</h1><nav>{links}</nav>"
        f"</header><main>{preface}{body}</main><footer>{escape(made)}</footer></body></html>\n"
    )
