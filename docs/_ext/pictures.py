"""Makes the figures of the explanation from what the tutorial left.

Each function of `docs/figures` is called with the tutorial's folder and returns a figure;
pages show it as ``/_pictures/NAME.png``.
"""

from __future__ import annotations

import json
from pathlib import Path

import matplotlib as mpl
from figures import FIGURES
from figures.density import PAGE
from sphinx.application import Sphinx
from sphinx.util import logging
from tutorial import DONE

from fusion.report.layout import figure_bytes

FOLDER = "_pictures"
MADE = "made.json"
logger = logging.getLogger(__name__)


def mark(tutorial: Path) -> str:
    """State of what figures are made of: the tutorial's run, tables, and what draws them."""
    of = json.loads((tutorial / DONE).read_text(encoding="utf-8"))["of"]
    drawing = Path(__file__).resolve().parents[1] / "figures"
    read = [*sorted(drawing.glob("*.py")), PAGE]
    return of + "".join(path.read_text(encoding="utf-8") for path in read)


def make(app: Sphinx) -> None:
    """Draw all figures, unless they are there."""
    tutorial = Path(app.config.TUTORIAL)
    folder = Path(app.srcdir) / FOLDER
    folder.mkdir(exist_ok=True)
    made, now = folder / MADE, mark(tutorial)
    if made.is_file() and made.read_text(encoding="utf-8") == now:
        return
    mpl.use("agg")
    for name, draw in FIGURES.items():
        logger.info("figure: %s", name)
        picture = figure_bytes(draw(tutorial), "png", dpi=110)
        (folder / f"{name}.png").write_bytes(picture)
    made.write_text(now, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Draw after the tutorial has run."""
    app.connect("builder-inited", make, priority=200)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
