"""Lists of images, landmarks and maps (PICTLIST, LMRKLIST, MAPLIST): names, then ``END``."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Literal

from spcola import atomic
from spcola.errors import InvalidValueError
from spcola.formats.solution.sections import read_name
from spcola.formats.text.lines import LineCursor
from spcola.formats.text.source import check_name

ListKind = Literal["image", "landmark"]

_END = "END"


def read_list(path: str | Path, *, kind: ListKind = "image") -> list[str]:
    """Read a list: one name on each line up to ``END``; the rest is ignored.

    Parameters
    ----------
    path : str or Path
        The file.
    kind : {"image", "landmark"}
        Type of the names: those of images have up to 12 characters, of landmarks and maps up to 6.

    Raises
    ------
    FormatError
        If a line has no name or several, a name is too long or appears twice, or ``END`` is
        missing (the file is truncated).
    """
    cursor = LineCursor(path)
    names: dict[str, int] = {}
    while (line := cursor.next(_END).strip()) != _END:
        name = read_name(cursor, line, kind)
        if name in names:
            raise cursor.error(
                f"{name} appears twice, first on line {names[name]}", "remove one line"
            )
        names[name] = cursor.number
    return list(names)


def write_list(path: str | Path, names: Iterable[str], *, kind: ListKind = "image") -> None:
    """Write a list of names and ``END``.

    Parameters
    ----------
    path : str or Path
    names : iterable of str
    kind : {"image", "landmark"}
        What is listed; it determines the longest name.

    Raises
    ------
    InvalidValueError
        If a name is too long for SPC, is ``END``, or appears twice.
    WorkspaceError
        If the file cannot be written.
    """
    seen: dict[str, None] = {}
    for name in names:
        check_name(name, kind, path)
        if name in seen or name == _END:
            raise InvalidValueError(f"{name} appears twice or is the end mark", path)
        seen[name] = None
    atomic.write_text(path, "".join(f"{name}\n" for name in (*seen, _END)))
