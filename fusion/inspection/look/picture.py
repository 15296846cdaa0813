"""A picture of a file, and where it is written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any

from fusion.report.layout import Colour, data_uri, figure_bytes
from spcola import atomic
from spcola.errors import WorkspaceError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUFFIXES = (".png", ".pdf", ".svg")
"""Endings of the files that a picture can be written as."""

# Stands in the first bytes of every PNG that is made here.
_MARK = "spcola look"
_MARK_WITHIN = 4096
# Letters of a caption in an inch.
_LETTERS_PER_IN = 13.5


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture of a file or a workspace.

    Parameters
    ----------
    kind : str
        What is drawn, such as "maplet" or "scan".
    figure : matplotlib Figure
    facts : mapping
        What was drawn, in JSON types or arrays: name, extents, counts. Units stand in the keys.
    """

    kind: str
    figure: Figure
    facts: Mapping[str, Any] = field(default_factory=dict)

    def _repr_html_(self) -> str:
        """Return the picture as an element of a notebook."""
        return f'<img alt="{escape(self.kind)}" src="{data_uri(self.figure, "png")}">'


def picture_path(source: Path, chosen: Path | None = None) -> Path:
    """Return where the picture of `source` is to be written.

    Without a choice it is ``NAME.png`` in the current folder. A file of that name is replaced only
    if it was made here; a file that the user names is replaced, but never `source` itself.

    Parameters
    ----------
    source : Path
        The file or workspace that is drawn.
    chosen : Path, optional
        Where the user wants the picture.

    Raises
    ------
    WorkspaceError
        If the picture may not be written there.
    """
    target = chosen or Path(f"{source.resolve().stem}.png")
    if target.suffix.lower() not in SUFFIXES:
        raise WorkspaceError(
            "is no name of a picture", target, f"end it with {', '.join(SUFFIXES)}"
        )
    if target.is_dir():
        raise WorkspaceError("is a folder", target, "name a file with -o")
    if target.exists() and source.exists() and target.samefile(source):
        raise WorkspaceError("is the file to be drawn itself", target, "name another with -o")
    if chosen is None and target.exists() and not _is_ours(target):
        raise WorkspaceError(
            "is there already, and was not made by spcola look", target, "name a file with -o"
        )
    return target


def save_picture(picture: Picture, path: Path) -> None:
    """Write a picture whole or not at all; the suffix chooses PNG, PDF or SVG.

    Equal pictures give equal files.

    Parameters
    ----------
    picture : Picture
    path : Path

    Raises
    ------
    WorkspaceError
        If the file cannot be written.
    """
    kind = path.suffix.lower().removeprefix(".")
    atomic.write_bytes(path, figure_bytes(picture.figure, kind, dpi=150, maker=_MARK))


def set_title(figure: Any, title: str, caption: str = "") -> None:
    """Write a heading over a figure, and a caption below it."""
    figure.suptitle(title, x=0.012, ha="left", fontsize=11, weight="bold", color=Colour.TEXT)
    figure.get_layout_engine().set(h_pad=0.09, w_pad=0.06)
    if caption:
        width = int(_LETTERS_PER_IN * figure.get_figwidth())
        lines = [line for part in caption.splitlines() for line in wrap(part, width)]
        figure.supxlabel("\n".join(lines), x=0.012, ha="left", fontsize=8.5, color=Colour.TEXT)


def _is_ours(path: Path) -> bool:
    """Return whether a file was made here."""
    try:
        with path.open("rb") as stream:
            return _MARK.encode() in stream.read(_MARK_WITHIN)
    except OSError:
        return False
