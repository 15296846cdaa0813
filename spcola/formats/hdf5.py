"""HDF5 files: written atomically, and checked completely when read."""

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

__all__ = [
    "read_layer",
    "read_names",
    "read_number",
    "read_text",
    "reading_hdf5",
    "replacing_hdf5",
    "sealed",
    "stored",
]

# From this version on HDF5 verifies checksums of its own structures, attributes included, before it
# follows them: a flipped bit is an error and no endless loop. Texts of variable length lie in heaps
# without a checksum, and are not written (:func:`stored`).
_WRITTEN = ("v110", "v110")
_NUMBERS = "iuf"
"""Kinds of NumPy dtypes that are real numbers."""

_SEAL = "seal"


class _Patient(io.FileIO):
    """A file that records a write error, and then discards further writes.

    HDF5 does not tolerate disk errors: it repeats a failed write whenever an object is closed, and
    finally crashes the interpreter.
    """

    error: OSError | None = None

    def write(self, data: Any) -> int:
        """Write all of `data`, unless an earlier write failed."""
        view = memoryview(data).cast("B")
        done = len(view) if self.error else 0
        try:
            # A plain file may write less than requested.
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
    """Yield an HDF5 file whose attribute ``format`` is `form`, read-only.

    On damaged files h5py raises various errors (OSError, RuntimeError, KeyError, TypeError,
    OverflowError ...). This is the one place that turns all of them into one line, so the block
    must contain nothing but reading.

    Parameters
    ----------
    path : str or Path
    form : str
        Required value of the attribute ``format``.
    what, do : str
        Message for a damaged file, and what to do about it.

    Raises
    ------
    FormatError
        If the file cannot be read, is of another form, or the block fails.
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
    group: Any, name: str, shape: tuple[int | None, ...], kinds: str = _NUMBERS
) -> AnyArray:
    """Return the dataset `name` of `group`, checked before it is read into memory.

    Parameters
    ----------
    group : h5py.Group
    name : str
    shape : tuple of int or None
        Required shape; None is any length that fits the file.
    kinds : str
        Allowed kinds of NumPy dtypes.

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
    # A dataset without storage is one constant; its size is limited by the check of its shape.
    if None in shape and data.nbytes > data.id.get_storage_size():
        raise InvalidValueError(f"states {data.nbytes} bytes, more than are stored", name)
    return data[()]


def read_number(node: Any, name: str) -> float:
    """Return the attribute `name` of a group or file; an InvalidValueError if it is no number."""
    value = node.attrs[name]
    if np.ndim(value) or np.asarray(value).dtype.kind not in _NUMBERS:
        raise InvalidValueError("is no number", name)
    return float(value)


def read_text(node: Any, name: str) -> str:
    """Return the attribute `name` of a group or file; an InvalidValueError if it is no text."""
    value = node.attrs[name]
    if isinstance(value, bytes):
        return value.decode("utf-8")
    if not isinstance(value, str):
        raise InvalidValueError("is no text", name)
    return value


def stored(text: str | Iterable[str]) -> AnyArray:
    """Return a text as attribute, or texts (N,) as dataset: UTF-8 of fixed length.

    :func:`read_text` and :func:`read_names` read them.
    """
    if isinstance(text, str):
        return stored([text]).reshape(())
    content = [name.encode("utf-8") for name in text]
    return np.array(content, dtype=f"S{max([1, *map(len, content)])}")


def read_names(group: Any, name: str, count: int) -> list[str]:
    """Return the dataset `name` of `group`; an InvalidValueError unless it is `count` texts."""
    values = read_layer(group, name, (count,), kinds="SO")
    return [value.decode("utf-8") for value in values]


@contextmanager
def new_hdf5(path: str | Path) -> Iterator[Any]:
    """Yield an empty HDF5 file; an OSError at the end of the block if it was not written."""
    with _Patient(path, "w+") as raw:
        try:
            with h5py.File(raw, "w", libver=_WRITTEN) as file:
                yield file
        except (RuntimeError, OSError):
            # A file that cannot be read back was not written.
            if raw.error is None:
                raise
        if raw.error is not None:
            raise raw.error


@contextmanager
def replacing_hdf5(path: str | Path, *, seal: bool = False) -> Iterator[Any]:
    """Yield an empty HDF5 file that replaces `path` when the block ends without an error.

    If `seal`, a checksum is added of all but the values of its datasets: see :func:`sealed`.

    Raises
    ------
    WorkspaceError
        If it cannot be written; the old file remains.
    """
    with replacing(path) as temporary, new_hdf5(temporary) as file:
        yield file
        if seal:
            file.attrs[_SEAL] = stored(_digest(file))


def sealed(file: Any) -> bool | None:
    """Return whether a file is as it was sealed; None if it has no such checksum.

    It covers the names of all groups and datasets, their attributes, and types and shapes of
    datasets; not their values, which need checksums among the attributes.
    """
    return read_text(file, _SEAL) == _digest(file) if _SEAL in file.attrs else None


def _plain(value: Any) -> Any:
    """Return the value of an attribute as a type of JSON."""
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
