"""Mapolas on disk: .MAP files and ``mapolas.h5`` with everything at full precision."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from lidar.gridding import Mapola
from spcola.formats.map_store import MapStore

MAPOLAS_HDF5 = "mapolas.h5"
"""Name of the HDF5 file in a folder of mapolas."""

MAPOLA_STORE = MapStore(
    kind="mapola",
    file=MAPOLAS_HDF5,
    form="spcola mapolas 2",
    layers=("height", "sigma", "albedo", "count", "spread"),
    make=Mapola,
    mappings=("scan_share",),
)
"""Storage of mapolas in a folder."""


def write_mapolas(folder: str | Path, mapolas: Iterable[Mapola]) -> list[str]:
    """Write mapolas as the new content of `folder`, and return their names.

    Each becomes ``NAME.MAP``, and a group of ``mapolas.h5`` with height, sigma, albedo, count,
    spread and the shares of the scans. An error leaves the folder as it was.

    Parameters
    ----------
    folder : str or Path
        It exists.
    mapolas : iterable of Mapola
        May be a generator: one is in memory at a time.

    Raises
    ------
    WorkspaceError
        If the folder cannot be written.
    InvalidValueError
        If two mapolas have the same name, or a name is no file name.
    """
    return MAPOLA_STORE.write(folder, mapolas)


def mapola_names(folder: str | Path) -> list[str]:
    """Return the names of the mapolas in `folder`, in alphabetical order.

    Raises
    ------
    WorkspaceError, FormatError
        If there is no ``mapolas.h5``, or it is something else.
    """
    return MAPOLA_STORE.names(folder)


def read_mapola(folder: str | Path, name: str) -> Mapola:
    """Read the mapola `name` from `folder` at full precision.

    Raises
    ------
    WorkspaceError
        If a file cannot be read, or there is no such mapola.
    FormatError
        If ``mapolas.h5`` is damaged or does not belong to ``NAME.MAP``.
    """
    return MAPOLA_STORE.read(folder, name)
