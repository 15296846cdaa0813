"""What fits into the memory of this machine: a grid that cannot is refused before it is made."""

from __future__ import annotations

import os

from spcola.errors import WorkspaceError

BYTES_PER_POINT = 200
"""Layers of 8 bytes that a grid point needs at least while heights are solved for: some 25."""

PROGRAM_BYTES = 2.6e8
"""The program itself, with its libraries."""


def check_grid(half_size: float, where: str, do: str) -> None:
    """Refuse a grid of (2q+1)² points that this machine cannot hold.

    Settings in the wrong unit (or a shape in metres that is read as kilometres) ask for such
    grids; the operating system would end the program without a word.

    Parameters
    ----------
    half_size : float
        q; infinite where a ground sample distance vanishes.
    where, do : str
        Of the error.

    Raises
    ------
    WorkspaceError
        With the memory that is needed, and that there is.
    """
    points = (2.0 * half_size + 1.0) ** 2
    needed, there = BYTES_PER_POINT * points, physical_memory()
    if needed > there:
        raise WorkspaceError(
            f"a grid of {2 * half_size + 1:.4g} points on a side needs {needed / 1e9:.3g} GB of "
            f"memory, this machine has {there / 1e9:.3g} GB",
            where,
            do,
        )


def physical_memory() -> int:
    """Return the memory of this machine, bytes."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
