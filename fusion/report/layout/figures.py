"""Style of all figures of the report, and their files."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from enum import StrEnum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Colour(StrEnum):
    """Colours (Okabe and Ito; Tol) that remain distinct for colour-blind readers."""

    SPC = "#0072b2"
    LIDAR = "#e69f00"
    FUSED = "#009e73"
    REJECTED = "#cc3311"
    TEXT = "#222222"
    GREY = "#8a8a8a"
    # Pale green, which is in none of the colour maps.
    MISSING = "#d5e8c0"


SOURCES = ("none", "image", "lidar", "both", "filled")
"""Words for each :class:`fusion.fusing.maplets.Source`, in its order."""
SOURCE_COLOURS = ("#ffffff", Colour.SPC, Colour.LIDAR, Colour.FUSED, "#bbbbbb")
"""Colours of them."""
CODED_COLOURS: Mapping[str, tuple[str, ...]] = {
    "source": SOURCE_COLOURS,
    "directions": ("#bbbbbb", Colour.LIDAR, Colour.SPC),
}
"""Colours of layers whose values are codes 0, 1, …: sources, and in how many directions images
determine a slope."""

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
    "text.color": Colour.TEXT,
    "axes.labelcolor": Colour.TEXT,
    "xtick.color": Colour.TEXT,
    "ytick.color": Colour.TEXT,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "svg.hashsalt": "spcola",
}


@contextmanager
def styled_figure(width: float, height: float) -> Iterator[Figure]:
    """Yield an empty figure (size in inches) in the report's style; global state is restored."""
    import matplotlib as mpl  # noqa: PLC0415  (0.4 s at start-up)
    from matplotlib.figure import Figure  # noqa: PLC0415

    with mpl.rc_context(_SETTINGS):
        yield Figure(figsize=(width, height), layout="constrained")


def coded_colours(layer: str) -> dict[str, Any]:
    """Return colour map and norm of an image of a layer of `CODED_COLOURS`, for ``imshow``."""
    from matplotlib.colors import BoundaryNorm, ListedColormap  # noqa: PLC0415

    colours = CODED_COLOURS[layer]
    norm = BoundaryNorm([code - 0.5 for code in range(len(colours) + 1)], len(colours))
    return {"cmap": ListedColormap(colours), "norm": norm}


def figure_bytes(figure: Figure, kind: str = "svg", *, dpi: int = 130, maker: str = "") -> bytes:
    """Return the content of the figure's file: equal figures give equal bytes.

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
