"""A folder of maplets: .MAP files for every SPC program, and one HDF5 file for everything else.

A .MAP quantises heights and has no place for sigma and further layers. The HDF5 file next to the
.MAP files contains these, and heights and frames at full precision: it is what is read back. It
also contains the digest of each .MAP, so that a changed .MAP, or one left by an interrupted run, is
detected.
"""

from __future__ import annotations

import hashlib
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from spcola.arrays import AnyArray
from spcola.atomic import flush, replacing, write_error
from spcola.errors import FormatError, InvalidValueError, WorkspaceError
from spcola.formats.hdf5 import (
    new_hdf5,
    read_layer,
    read_names,
    read_number,
    read_text,
    reading_hdf5,
    stored,
)
from spcola.formats.maplets import sigma_path
from spcola.formats.maplets.map import map_content
from spcola.formats.maplets.map_header import map_length
from spcola.formats.maplets.sigma import sigma_content
from spcola.grids import Maplet, MapletGrid

__all__ = ["MapStore"]

M = TypeVar("M", bound=Maplet)


@dataclass(frozen=True)
class MapStore(Generic[M]):
    """Storage of maplets of one type in a folder.

    Parameters
    ----------
    kind : str
        Name of the type, in words ("fused maplet").
    file : str
        Name of the HDF5 file.
    form : str
        Name and version of its format, stored inside.
    layers : tuple of str
        Attributes stored as arrays, including height, sigma and albedo.
    make : callable
        Makes the value again from name and grid, and from layers, ``center_sigma`` and mappings
        as keywords: usually the class.
    mappings : tuple of str
        Attributes stored as mappings of str to float.
    """

    kind: str
    file: str
    form: str
    layers: tuple[str, ...]
    make: Callable[..., M]
    mappings: tuple[str, ...] = ()

    def write(
        self, folder: str | Path, maplets: Iterable[M], *, sigma_companions: bool = False
    ) -> list[str]:
        """Write maplets as the new content of `folder`, and return their names.

        One is in memory at a time. All are first written next to their final places and renamed at
        the end: an error or a full disk leaves the folder unchanged. .MAP files of the old HDF5
        that are no longer made are removed.

        Raises
        ------
        WorkspaceError
            If the folder cannot be written.
        InvalidValueError
            If two maplets have the same name, or a name is no file name.
        """
        folder = Path(folder)
        former = self._former(folder)
        try:
            # The user may have removed it, to have its content made again.
            folder.mkdir(exist_ok=True)
            staging = Path(tempfile.mkdtemp(prefix=".maps.", suffix=".part", dir=folder))
        except OSError as error:
            raise write_error(folder, error) from error
        try:
            with replacing(folder / self.file) as temporary:
                names = self._stage(temporary, staging, maplets, sigma_companions)
                staged = sorted(staging.iterdir())
                # All at the end: each one would wait for all earlier writes.
                flush(staged)
                for path in staged:
                    path.replace(folder / path.name)
            for name in set(former) - set(names):
                (folder / f"{name}.MAP").unlink(missing_ok=True)
                sigma_path(folder / f"{name}.MAP").unlink(missing_ok=True)
        finally:
            shutil.rmtree(staging, ignore_errors=True)
        return names

    def names(self, folder: str | Path) -> list[str]:
        """Return the names of the maplets in `folder`, in alphabetical order.

        Raises
        ------
        WorkspaceError, FormatError
            If there is no HDF5, or it is something else.
        """
        with self._opened(Path(folder) / self.file) as file:
            return sorted(str(name) for name in file)

    def read(self, folder: str | Path, name: str) -> M:
        """Read the maplet `name` at full precision.

        Raises
        ------
        WorkspaceError
            If a file cannot be read, or there is no such maplet.
        FormatError
            If the HDF5 is something else or damaged, or does not belong to ``NAME.MAP``.
        """
        map_path = Path(folder) / f"{name}.MAP"
        with self._group(folder, name) as group:
            self._check_digest(group, map_path)
            return self._load(group, name, map_path.stat().st_size)

    def grid(self, folder: str | Path, name: str) -> MapletGrid:
        """Return the grid of the maplet `name`; raises as :meth:`read`."""
        map_path = Path(folder) / f"{name}.MAP"
        with self._group(folder, name) as group:
            self._check_digest(group, map_path)
            return _load_grid(group, map_path.stat().st_size)

    def part(
        self, folder: str | Path, name: str, layer: str, rows: slice, columns: slice
    ) -> AnyArray:
        """Read part of one of the `layers` of the maplet `name`; raises as :meth:`read`.

        Only this part is read, and the .MAP is not compared again: see :meth:`grid`.
        """
        with self._group(folder, name) as group:
            data = group[layer]
            if data.ndim != 2 or data.dtype.kind not in "iuf":
                raise InvalidValueError("is no layer of numbers", layer)
            return data[rows, columns]

    @contextmanager
    def _group(self, folder: str | Path, name: str) -> Iterator[Any]:
        """Yield the group of the maplet `name`."""
        path = Path(folder) / self.file
        with self._opened(path, f"is damaged at {name}") as file:
            if name not in file:
                raise WorkspaceError(f"holds no {self.kind} {name}", path, self._again)
            yield file[name]

    def _check_digest(self, group: Any, map_path: Path) -> None:
        """Refuse a .MAP that is not the one of its group."""
        if self._digest(map_path) != read_text(group, "map_sha256"):
            raise FormatError(f"is not the map that {self.file} describes", map_path, self._again)

    @property
    def _again(self) -> str:
        """Advice for a folder that cannot be used."""
        return f"make the {self.kind}s again"

    def _former(self, folder: Path) -> list[str]:
        """Names in the old HDF5; none if it is damaged, since it is being replaced."""
        try:
            return self.names(folder) if (folder / self.file).exists() else []
        except (FormatError, WorkspaceError):
            return []

    def _stage(
        self, hdf5: Path, staging: Path, maplets: Iterable[M], companions: bool
    ) -> list[str]:
        """Write the HDF5 and, into `staging`, the .MAP files; return the names."""
        names: list[str] = []
        folder = hdf5.parent
        with new_hdf5(hdf5) as file:
            file.attrs["format"] = stored(self.form)
            for maplet in maplets:
                self._check_name(maplet.name, names)
                path, content = staging / f"{maplet.name}.MAP", map_content(maplet)
                try:
                    path.write_bytes(content)
                    if companions:
                        sigma_path(path).write_bytes(sigma_content(maplet.sigma))
                except OSError as error:
                    raise write_error(folder / path.name, error) from error
                digest = hashlib.sha256(content).hexdigest()
                self._store(file.create_group(maplet.name), maplet, digest)
                names.append(maplet.name)
        return names

    def _check_name(self, name: str, taken: list[str]) -> None:
        """Refuse a name that is taken, or that would hide the file or lead out of the folder."""
        if name in taken:
            raise InvalidValueError(f"two {self.kind}s have this name", name)
        if not name or Path(name).name != name or name.startswith("."):
            raise InvalidValueError("is no name for a file", repr(name))

    def _store(self, group: Any, maplet: M, digest: str) -> None:
        """Write one maplet into its group, with the digest of its .MAP."""
        for layer in self.layers:
            _store_layer(group, layer, getattr(maplet, layer))
        grid = maplet.grid
        group.attrs.update(
            center=grid.center, axes=grid.axes, gsd=grid.gsd, half_size=grid.half_size
        )
        group.attrs["center_sigma"] = maplet.center_sigma
        group.attrs["map_sha256"] = stored(digest)
        for mapping in self.mappings:
            _store_mapping(group.create_group(mapping), getattr(maplet, mapping))

    def _load(self, group: Any, name: str, map_bytes: int) -> M:
        """Read one maplet, whose .MAP has so many bytes, from its group."""
        grid = _load_grid(group, map_bytes)
        layers = {layer: read_layer(group, layer, grid.shape) for layer in self.layers}
        mappings = {mapping: _load_mapping(group[mapping]) for mapping in self.mappings}
        sigma = group.attrs["center_sigma"]
        return self.make(name, grid, **layers, center_sigma=sigma, **mappings)

    def _opened(self, path: Path, what: str = "is damaged") -> AbstractContextManager[Any]:
        """Open the HDF5 for reading, refused if it is something else."""
        return reading_hdf5(path, self.form, what, self._again)

    def _digest(self, path: Path) -> str:
        """SHA-256 of a file."""
        try:
            return hashlib.sha256(path.read_bytes()).hexdigest()
        except OSError as error:
            raise WorkspaceError(f"cannot be read ({error.strerror})", path, self._again) from error


def _load_grid(group: Any, map_bytes: int) -> MapletGrid:
    """Read the grid of one maplet, whose .MAP has so many bytes, from its group."""
    half_size = int(read_number(group, "half_size"))
    # A constant layer takes no space here, whatever its shape: the .MAP has the size.
    if map_length(half_size) != map_bytes:
        raise InvalidValueError(f"of {half_size} is not that of its .MAP", "half_size")
    kept = group.attrs
    return MapletGrid(kept["center"], kept["axes"], read_number(group, "gsd"), half_size)


def _store_layer(group: Any, name: str, values: AnyArray) -> None:
    """Write a layer into its group; a constant takes no space.

    Nothing is compressed: the last digits of heights are noise, and compression takes most of the
    time of writing to save a seventh of the space.
    """
    first = values.flat[0]
    if (values == first).all() or np.isnan(values).all():
        group.create_dataset(name, values.shape, values.dtype, fillvalue=first)
    else:
        group.create_dataset(name, data=values)


def _store_mapping(group: Any, mapping: Mapping[str, float]) -> None:
    """Write a mapping into its group, as two arrays: attributes end at 64 KiB."""
    group["keys"] = stored(mapping)
    group["values"] = np.array(list(mapping.values()), dtype=np.float64)


def _load_mapping(group: Any) -> dict[str, float]:
    """Read a mapping from its group."""
    values = read_layer(group, "values", (None,)).astype(np.float64).tolist()
    return dict(zip(read_names(group, "keys", len(values)), values, strict=True))
