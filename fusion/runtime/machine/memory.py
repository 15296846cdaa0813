"""Memory of this machine: a grid that does not fit is refused before it is made."""

from __future__ import annotations

import os

from spcola.errors import WorkspaceError

BYTES_PER_POINT = 200
"""Least memory per grid point while heights are solved for: some 25 layers of 8 bytes."""

PROGRAM_BYTES = 2.6e8
"""Memory of the program itself, with its libraries."""


def check_grid(half_size: float, where: str, do: str) -> None:
    """Refuse a grid of (2q+1)² points that this machine cannot hold.

    Settings in a wrong unit (or a shape in metres read as kilometres) ask for such grids; the
    operating system would end the program without a message.

    Parameters
    ----------
    half_size : float
        q; infinite if a ground sample distance is zero.
    where, do : str
        Place and advice of the error.

    Raises
    ------
    WorkspaceError
        If the grid does not fit; with the memory needed and available.
    """
    points = (2.0 * half_size + 1.0) ** 2
    side = f"a grid of {2 * half_size + 1:.4g} points on a side"
    check_memory(BYTES_PER_POINT * points, side, where, do)


def check_memory(needed: float, what: str, where: str, do: str) -> None:
    """Refuse what this machine cannot hold.

    Parameters
    ----------
    needed : float
        Bytes.
    what : str
        What needs them, for the message.
    where, do : str
        Place and advice of the error.

    Raises
    ------
    WorkspaceError
        With the memory needed and available.
    """
    there = physical_memory()
    if needed > there:
        raise WorkspaceError(
            f"{what} needs {needed / 1e9:.3g} GB of memory, this machine has {there / 1e9:.3g} GB",
            where,
            do,
        )


def physical_memory() -> int:
    """Return the memory of this machine, bytes."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
