"""Fields that the options of several commands share, and the marks of special ones."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from enum import Enum
from typing import Annotated, Any

import typer

NAIF_NUMBERS: dict[str, Any] = {"min": -(10**9), "max": 10**9}
"""Limits of numbers of bodies, spacecraft and instruments in SPICE."""
FACES_FROM: Any = typer.Option(
    min=0, max=1, help="Number of the first vertex in the faces of an OBJ: 1, or 0."
)


class Mark(Enum):
    """What a path or a list of texts is, where its type does not state it."""

    OUTPUT = "output"  # a file or folder that the command writes
    FOLDER = "folder"  # a folder that it reads
    COLUMNS = "columns"  # pairs NAME=COLUMN


SolutionOption = Annotated[
    str,
    typer.Option(metavar="NAME", help="The SPC solution; by default the one in use."),
]


def each_between(least: float, most: float) -> Callable[[Any], Any]:
    """Return a callback that refuses an option of several numbers if one is outside limits."""

    def check(values: tuple[float, ...] | None) -> tuple[float, ...] | None:
        for value in values or ():
            if not least <= value <= most:
                raise typer.BadParameter(f"{value} is not in the range {least:g} to {most:g}.")
        return values

    return check


def named_columns(texts: Iterable[str], form: str) -> dict[str, str]:
    """Return the columns that ``--columns`` names, by what they are.

    Parameters
    ----------
    texts : iterable of str
        Such as ``x=X [km]``.
    form : str
        For messages: ``NAME=COLUMN``.

    Raises
    ------
    typer.BadParameter
        If one of them is no such pair.
    """
    pairs = {}
    for text in texts:
        name, sign, column = text.partition("=")
        if not (sign and name.strip() and column.strip()):
            raise typer.BadParameter(f"{text!r} is not {form}", param_hint="--columns")
        pairs[name.strip()] = column.strip()
    return pairs
