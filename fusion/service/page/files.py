"""The files of the built page."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

STATIC = Path(str(files("fusion.service.page"))) / "static"
"""Folder of the built page: ``index.html``, and scripts and styles with a digest in their names."""


def is_built() -> bool:
    """Return whether the page has been built."""
    return (STATIC / "index.html").is_file()
