"""Mapolas on disk: .MAP files for every SPC program, and one HDF5 for what a .MAP cannot hold.

A .MAP quantises heights and has no place for count, spread, sigma and scans. ``mapolas.h5``
beside the .MAP files holds these, and the heights and frames at full precision: it is what
:func:`read_mapola` reads. It also knows the digest of each .MAP, so that a .MAP that was
changed, or that an interrupted run left behind, is noticed and not mixed up.
"""

from __future__ import annotations

import hashlib
import shutil
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from lidar.mapola import Mapola
from spcola.atomic import replacing, write_error
from spcola.errors import FormatError, InvalidValueError, WorkspaceError
from spcola.formats.map import write_maplet
from spcola.maplet import MapletGrid

MAPOLAS_HDF5 = "mapolas.h5"
"""Name of the HDF5 file in a folder of mapolas."""

_FORMAT = "spcola mapolas 1"
_AGAIN = "make the mapolas again"


def write_mapolas(folder: str | Path, mapolas: Iterable[Mapola]) -> list[str]:
    """Write mapolas as the new content of `folder`, and return their names.

    One mapola is in memory at a time. All are first written beside their final places and
    renamed at the end: an error or a full disk in between leaves the folder as it was. .MAP
    files of mapolas that ``mapolas.h5`` knew before and that are no longer made are removed.

    Parameters
    ----------
    folder : str or Path
        Where ``NAME.MAP`` and ``mapolas.h5`` go; it exists.
    mapolas : iterable of Mapola
        May be a generator.

    Raises
    ------
    WorkspaceError
        If the folder cannot be written.
    InvalidValueError
        If two mapolas bear one name, or a name is no file name.
    """
    folder = Path(folder)
    former = _former_names(folder)
    try:
        staging = Path(tempfile.mkdtemp(prefix=".mapolas.", suffix=".part", dir=folder))
    except OSError as error:
        raise write_error(folder, error) from error
    names: list[str] = []
    try:
        with replacing(folder / MAPOLAS_HDF5) as temporary:
            with h5py.File(temporary, "w") as file:
                file.attrs["format"] = _FORMAT
                for mapola in mapolas:
                    _check_name(mapola.name, names)
                    path = staging / f"{mapola.name}.MAP"
                    write_maplet(path, mapola)
                    _store(file.create_group(mapola.name), mapola, path)
                    names.append(mapola.name)
            for name in names:
                (staging / f"{name}.MAP").replace(folder / f"{name}.MAP")
        for name in set(former) - set(names):
            (folder / f"{name}.MAP").unlink(missing_ok=True)
    finally:
        shutil.rmtree(staging, ignore_errors=True)
    return names


def mapola_names(folder: str | Path) -> list[str]:
    """Return the names of the mapolas in `folder`, in the order of the alphabet.

    Raises
    ------
    WorkspaceError, FormatError
        If there is no ``mapolas.h5``, or it is something else.
    """
    with _opened(Path(folder) / MAPOLAS_HDF5) as file:
        return sorted(file)


def read_mapola(folder: str | Path, name: str) -> Mapola:
    """Read the mapola `name` at full precision.

    Raises
    ------
    WorkspaceError
        If a file cannot be read, or there is no such mapola.
    FormatError
        If the HDF5 is something else or damaged, or does not belong to ``NAME.MAP``.
    """
    path = Path(folder) / MAPOLAS_HDF5
    with _opened(path) as file:
        if name not in file:
            raise WorkspaceError(f"holds no mapola {name}", path, _AGAIN)
        try:
            mapola, digest = _load(file[name], name)
        except (KeyError, OSError, ValueError, TypeError, InvalidValueError) as error:
            raise FormatError(f"is damaged at {name} ({error})", path, _AGAIN) from error
    map_path = Path(folder) / f"{name}.MAP"
    if _digest(map_path) != digest:
        raise FormatError(f"is not the map that {MAPOLAS_HDF5} describes", map_path, _AGAIN)
    return mapola


def _former_names(folder: Path) -> list[str]:
    """Names that ``mapolas.h5`` holds so far; none if it is damaged, for it is being replaced."""
    try:
        return mapola_names(folder) if (folder / MAPOLAS_HDF5).exists() else []
    except (FormatError, WorkspaceError):
        return []


def _check_name(name: str, names: list[str]) -> None:
    """Refuse a name that is taken, or that would lead out of the folder."""
    if name in names:
        raise InvalidValueError("two mapolas bear this name", name)
    if not name or Path(name).name != name or name.startswith("."):
        raise InvalidValueError("is no name for a file", repr(name))


def _digest(path: Path) -> str:
    """SHA-256 of a file."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise WorkspaceError(f"cannot be read ({error.strerror})", path, _AGAIN) from error


def _opened(path: Path) -> Any:
    """Open ``mapolas.h5`` for reading, refused if it is something else."""
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        raise WorkspaceError("cannot be read as HDF5", path, _AGAIN) from error
    if file.attrs.get("format") != _FORMAT:
        file.close()
        raise FormatError(f"is not {_FORMAT!r}", path, _AGAIN)
    return file


def _store(group: Any, mapola: Mapola, map_path: Path) -> None:
    """Write one mapola into its group."""
    packed = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
    for layer in ("height", "sigma", "albedo", "count", "spread"):
        group.create_dataset(layer, data=getattr(mapola, layer), **packed)
    grid = mapola.grid
    group.attrs.update(center=grid.center, axes=grid.axes, gsd=grid.gsd, half_size=grid.half_size)
    group.attrs["center_sigma"] = mapola.center_sigma
    group.attrs["map_sha256"] = _digest(map_path)
    group["scan_names"] = np.array(list(mapola.scan_share), dtype=h5py.string_dtype())
    group["scan_shares"] = np.array(list(mapola.scan_share.values()), dtype=np.float64)


def _load(group: Any, name: str) -> tuple[Mapola, str]:
    """Read one mapola from its group, and the digest of its .MAP."""
    attributes = group.attrs
    grid = MapletGrid(
        attributes["center"],
        attributes["axes"],
        float(attributes["gsd"]),
        int(attributes["half_size"]),
    )
    names = group["scan_names"].asstr()[:]
    mapola = Mapola(
        name,
        grid,
        group["height"][:],
        albedo=group["albedo"][:],
        sigma=group["sigma"][:],
        center_sigma=attributes["center_sigma"],
        count=group["count"][:],
        spread=group["spread"][:],
        scan_share=dict(zip(names, group["scan_shares"][:].tolist(), strict=True)),
    )
    return mapola, str(attributes["map_sha256"])
