"""HDF5 files: written whole or not at all, read as if nothing in them could be trusted."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from spcola.arrays import AnyArray
from spcola.atomic import replacing
from spcola.errors import FormatError, InvalidValueError, SpcolaError
from spcola.formats.text.source import regular_size

# From this version on HDF5 checks sums of what it reads of its own structures, attributes included,
# before it follows them: a flipped bit is an error and no endless loop. Texts of variable length
# lie in heaps without a sum, and are not written (:func:`stored`).
_WRITTEN = ("v110", "v110")
NUMBERS = "iuf"
"""Kinds of NumPy types that are real numbers."""

_SEAL = "seal"


class _Patient(io.FileIO):
    """A file that notes that it could not be written, and goes on as if it had been.

    HDF5 does not bear errors of the disk: what it could not write it tries to write again whenever
    an object is closed, and in the end it brings the interpreter down.
    """

    error: OSError | None = None

    def write(self, data: Any) -> int:
        """Write all of `data`, unless an earlier write failed."""
        view = memoryview(data).cast("B")
        done = len(view) if self.error else 0
        try:
            # A plain file may write less than it is asked to.
            while done < len(view):
                done += super().write(view[done:]) or 0
        except OSError as error:
            self.error = error
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Change the size, unless an earlier write failed."""
        try:
            if self.error is None:
                return super().truncate(size)
        except OSError as error:
            self.error = error
        return self.tell() if size is None else size


@contextmanager
def reading_hdf5(path: str | Path, form: str, what: str, do: str) -> Iterator[Any]:
    """Yield an HDF5 file whose attribute ``format`` is `form`, for reading alone.

    On damaged files h5py raises whatever its layers happen to meet (OSError, RuntimeError,
    KeyError, TypeError, OverflowError ...). This is the one place that turns all of it into one
    line, so nothing but reading may stand within the block.

    Parameters
    ----------
    path : str or Path
    form : str
        What the attribute ``format`` has to be.
    what, do : str
        What to say of a file that is damaged, and what to do about it.

    Raises
    ------
    FormatError
        If the file cannot be read, is of another form, or the block fails on what is in it.
    """
    try:
        regular_size(path)
        with h5py.File(path, "r") as file:
            if "format" not in file.attrs or read_text(file, "format") != form:
                raise FormatError(f"is an HDF5 file, but not {form!r}", path, do)
            yield file
    except InvalidValueError as error:
        raise FormatError(f"{what} ({error})", path, do) from error
    except SpcolaError:
        raise
    except Exception as error:
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise FormatError(f"{what} ({reason})", path, do) from error


def read_layer(
    group: Any, name: str, shape: tuple[int | None, ...], kinds: str = NUMBERS
) -> AnyArray:
    """Return the dataset `name` of `group`, checked before anything of it is in memory.

    Parameters
    ----------
    group : h5py.Group
    name : str
    shape : tuple of int or None
        What it has to be; None is any length that the file has room for.
    kinds : str
        Kinds of NumPy types that it may have.

    Raises
    ------
    InvalidValueError
        If it is no dataset, or of another shape or type.
    """
    data = group[name]
    if not isinstance(data, h5py.Dataset):
        raise InvalidValueError("is no dataset", name)
    if data.dtype.kind not in kinds:
        raise InvalidValueError(f"is of type {data.dtype}", name)
    found = data.shape or ()
    fits = len(found) == len(shape)
    if not fits or any(w not in (None, n) for n, w in zip(found, shape, strict=True)):
        raise InvalidValueError(f"is of shape {found}", name)
    # What is not stored is one number throughout, and has the room that its shape is checked for.
    if None in shape and data.nbytes > data.id.get_storage_size():
        raise InvalidValueError(f"says {data.nbytes} bytes, more than are stored", name)
    values: AnyArray = data[()]
    return values


def read_number(node: Any, name: str) -> float:
    """Return the attribute `name` of a group or file: one real number.

    Raises
    ------
    InvalidValueError
        If it is something else.
    """
    value = node.attrs[name]
    if np.ndim(value) or np.asarray(value).dtype.kind not in NUMBERS:
        raise InvalidValueError("is no number", name)
    return float(value)


def read_text(node: Any, name: str) -> str:
    """Return the attribute `name` of a group or file: a text.

    Raises
    ------
    InvalidValueError
        If it is something else.
    """
    value = node.attrs[name]
    if isinstance(value, bytes):
        return value.decode("utf-8")
    if not isinstance(value, str):
        raise InvalidValueError("is no text", name)
    return value


def stored(text: str) -> AnyArray:
    """Return a text as an attribute keeps it: UTF-8 of fixed length; :func:`read_text` reads it."""
    content = text.encode("utf-8")
    return np.array(content, dtype=f"S{max(len(content), 1)}")


def stored_names(names: Iterable[str]) -> AnyArray:
    """Return texts (N,) as a dataset keeps them; :func:`read_names` reads it."""
    content = [name.encode("utf-8") for name in names]
    return np.array(content, dtype=f"S{max([1, *map(len, content)])}")


def read_names(group: Any, name: str, count: int) -> list[str]:
    """Return the dataset `name` of `group`: so many texts.

    Raises
    ------
    InvalidValueError
        If it is something else.
    """
    values = read_layer(group, name, (count,), kinds="SO")
    return [value.decode("utf-8") for value in values]


@contextmanager
def new_hdf5(path: str | Path) -> Iterator[Any]:
    """Yield an empty HDF5 file.

    Raises
    ------
    OSError
        If it could not be written; at the end of the block.
    """
    with _Patient(path, "w+") as raw:
        try:
            with h5py.File(raw, "w", libver=_WRITTEN) as file:
                yield file
        except (RuntimeError, OSError):
            # What cannot be read back was not written.
            if raw.error is None:
                raise
        if raw.error is not None:
            raise raw.error


@contextmanager
def replacing_hdf5(path: str | Path) -> Iterator[Any]:
    """Yield an empty HDF5 file that takes the place of `path` when the block ends without an error.

    Raises
    ------
    WorkspaceError
        If it cannot be written; what was there before stays.
    """
    with replacing(path) as temporary, new_hdf5(temporary) as file:
        yield file


def seal(file: Any) -> None:
    """Give a file a checksum of all that it holds but the values of its datasets, as `sealed`."""
    file.attrs[_SEAL] = stored(_digest(file))


def sealed(file: Any) -> bool | None:
    """Tell whether a file is as `seal` left it; None if it has no such checksum.

    It covers the names of all groups and datasets, their attributes, and types and shapes of
    datasets; not their values, which are to have checksums among the attributes.
    """
    return read_text(file, _SEAL) == _digest(file) if _SEAL in file.attrs else None


def _plain(value: Any) -> Any:
    """Return the value of an attribute as JSON knows it."""
    if isinstance(value, str):
        return value
    return value.decode("latin-1") if isinstance(value, bytes) else np.asarray(value).tolist()


def _digest(file: Any) -> str:
    """SHA-256 over all nodes of a file, hexadecimal."""
    digest = hashlib.sha256()

    def add(name: str, node: Any) -> None:
        attributes = {key: _plain(value) for key, value in node.attrs.items() if key != _SEAL}
        form = [node.dtype.str, list(node.shape)] if isinstance(node, h5py.Dataset) else []
        digest.update(json.dumps([name, form, attributes], sort_keys=True).encode())

    add("/", file)
    file.visititems(add)
    return digest.hexdigest()
