"""Warns of pages that would fetch a script, style, font or picture from another host."""

from __future__ import annotations

import re
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.util import logging

# Links that a reader may click are none of these.
FETCHED = re.compile(
    r"<(?:script|img|iframe|source|video|audio|embed)\b[^>]*?\bsrc=[\"']?((?:https?:)?//[^\"'\s>]+)"
    r"|<link\b(?![^>]*rel=[\"']?(?:canonical|license|search))[^>]*?\bhref=[\"']?((?:https?:)?//[^\"'\s>]+)"
    r"|url\([\"']?((?:https?:)?//[^\"')]+)|@import\s+[\"']((?:https?:)?//[^\"']+)",
    re.IGNORECASE,
)
logger = logging.getLogger(__name__)


def check(app: Sphinx, exception: Exception | None) -> None:
    """Look through all pages and styles that were written."""
    if exception is not None:
        return
    out = Path(app.outdir)
    for path in sorted([*out.rglob("*.html"), *out.rglob("*.css")]):
        for match in FETCHED.finditer(path.read_text(encoding="utf-8")):
            address = next(filter(None, match.groups()))
            logger.warning("%s fetches %s while it is read", path.relative_to(out), address)


def setup(app: Sphinx) -> dict[str, bool]:
    """Look after the build."""
    app.connect("build-finished", check)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
