"""Style of all figures of the report, and their embedding into the page."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SPC, LIDAR, FUSED, REJECTED = "#0072b2", "#e69f00", "#009e73", "#cc3311"
"""Colours (Okabe and Ito; Tol) that remain distinct for colour-blind readers."""
INK, MUTED = "#222222", "#8a8a8a"

SOURCES = ("none", "image", "lidar", "both", "filled")
"""Words for each :class:`fusion.fusing.maplets.Source`, in its order."""
SOURCE_COLOURS = ("#ffffff", SPC, LIDAR, FUSED, "#bbbbbb")
"""Colours of them."""

_SETTINGS: dict[str, Any] = {
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9,
    "axes.edgecolor": "#666666",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "text.color": INK,
    "axes.labelcolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "svg.hashsalt": "spcola",
}


@contextmanager
def drawing(width: float, height: float) -> Iterator[Figure]:
    """Yield an empty figure (size in inches) in the report's style; global state is restored."""
    import matplotlib as mpl  # noqa: PLC0415  (0.4 s at start-up)
    from matplotlib.figure import Figure  # noqa: PLC0415

    with mpl.rc_context(_SETTINGS):
        yield Figure(figsize=(width, height), layout="constrained")


def saved(figure: Figure, kind: str = "svg", *, dpi: int = 130, maker: str = "") -> bytes:
    """Return the figure as a file: equal figures give equal bytes.

    Parameters
    ----------
    figure : Figure
    kind : {"svg", "png", "pdf"}
    dpi : int
        Dots per inch, of a PNG.
    maker : str
        Stands in the file as the program that made it; nothing if empty.
    """
    import matplotlib as mpl  # noqa: PLC0415

    key = "Software" if kind == "png" else "Creator"
    undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind, {})
    stream = io.BytesIO()
    with mpl.rc_context(_SETTINGS):
        figure.savefig(
            stream,
            format=kind,
            dpi=dpi if kind == "png" else "figure",
            metadata={**undated, key: maker or None},
        )
    return stream.getvalue()


def data_uri(figure: Figure, kind: Literal["png", "svg"] = "svg") -> str:
    """Return the figure as a data URI; equal figures give equal text."""
    mime = "image/svg+xml" if kind == "svg" else "image/png"
    return f"data:{mime};base64,{base64.b64encode(saved(figure, kind)).decode('ascii')}"


def html_figure(
    figure: Figure, caption: str, alternative: str, kind: Literal["png", "svg"] = "svg"
) -> str:
    """Return the element of a page that shows a figure above its caption (HTML)."""
    return (
        f'<figure><img alt="{escape(alternative)}" src="{data_uri(figure, kind)}">'
        f"<figcaption>{caption}</figcaption></figure>"
    )
