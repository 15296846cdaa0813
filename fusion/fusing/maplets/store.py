"""Fused maplets on disk: .MAP files and ``fused.h5`` with everything at full precision."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from fusion.fusing.maplets.maplet import FusedMaplet
from spcola.formats.map_store import MapStore

FUSED_HDF5 = "fused.h5"
"""Name of the HDF5 file in a folder of fused maplets."""

FUSED_STORE = MapStore(
    kind="fused maplet",
    file=FUSED_HDF5,
    form="spcola fused maplets 1",
    layers=("height", "sigma", "albedo", "count", "source"),
    make=FusedMaplet,
)
"""Storage of fused maplets in a folder."""


def write_fused(
    folder: str | Path, maplets: Iterable[FusedMaplet], *, sigma_companions: bool = False
) -> list[str]:
    """Write fused maplets as the new content of `folder`, and return their names.

    Each becomes ``NAME.MAP``, and a group of ``fused.h5`` with height, sigma, albedo, count and
    source. An error leaves the folder as it was.

    Parameters
    ----------
    folder : str or Path
        An existing folder.
    maplets : iterable of FusedMaplet
        May be a generator: one is in memory at a time.
    sigma_companions : bool
        Also write ``NAME.SIG``, from which the SPC programs read sigma.

    Raises
    ------
    WorkspaceError
        If the folder cannot be written.
    InvalidValueError
        If two maplets have one name, or a name is not a valid file name.
    """
    return FUSED_STORE.write(folder, maplets, sigma_companions=sigma_companions)


def fused_names(folder: str | Path) -> list[str]:
    """Return the names of the fused maplets in `folder`, in alphabetical order.

    Raises
    ------
    WorkspaceError, FormatError
        If there is no ``fused.h5``, or it is something else.
    """
    return FUSED_STORE.names(folder)


def read_fused(folder: str | Path, name: str) -> FusedMaplet:
    """Read a fused maplet from `folder` at full precision.

    Parameters
    ----------
    folder : str or Path
    name : str
        Of the maplet, without ``.MAP``.

    Raises
    ------
    WorkspaceError
        If a file cannot be read, or there is no such maplet.
    FormatError
        If ``fused.h5`` is damaged or does not belong to ``NAME.MAP``.
    """
    return FUSED_STORE.read(folder, name)
