"""Values as text and arrays: for a digest of what goes into an item, and for keeping its result."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from spcola.arrays import AnyArray

_PACKAGES = ("spcola", "lidar", "fusion")


class Encoded(NamedTuple):
    """A value as JSON types and arrays.

    Attributes
    ----------
    text : str
        JSON in ASCII; arrays stand in it by their number.
    arrays : list of ndarray
    """

    text: str
    arrays: list[AnyArray]

    @property
    def digest(self) -> str:
        """SHA-256 of text and arrays, hexadecimal: equal for equal values only."""
        digest = hashlib.sha256(self.text.encode("ascii"))
        for array in self.arrays:
            digest.update(f"{array.dtype.str}{array.shape}".encode())
            digest.update(np.ascontiguousarray(array).data.cast("B") if array.size else b"")
        return digest.hexdigest()


def encode(value: Any) -> Encoded:
    """Write a value as JSON types and arrays.

    Parameters
    ----------
    value
        None, a number, text, path, array, or an enum, named tuple or dataclass of this program, or
        a tuple, list, dict or set of these.

    Raises
    ------
    TypeError
        If something else is in it, such as a function.
    """
    arrays: list[AnyArray] = []
    return Encoded(json.dumps(_written(value, arrays), separators=(",", ":")), arrays)


def decode(encoded: Encoded) -> Any:
    """Return the value that :func:`encode` wrote.

    Raises
    ------
    ValueError, KeyError, TypeError, AttributeError, ImportError
        If it is not what `encode` writes, or names a class that this version does not have.
    """
    return _read(json.loads(encoded.text), encoded.arrays)


def _written(value: Any, arrays: list[AnyArray]) -> Any:
    """Return JSON types; every container is a list that begins with its type."""
    if isinstance(value, Enum):
        return ["enum", _name_of(type(value)), value.name]
    if value is None or type(value) in (bool, int, float, str):
        return value
    if isinstance(value, np.ndarray | np.generic):
        array = np.asarray(value)
        if array.dtype.hasobject:
            raise TypeError("arrays of objects cannot be kept")
        arrays.append(array)
        return ["array" if isinstance(value, np.ndarray) else "scalar", len(arrays) - 1]
    if isinstance(value, Path):
        return ["path", str(value)]
    if is_dataclass(value) and not isinstance(value, type):
        content = [[each.name, getattr(value, each.name)] for each in fields(value) if each.init]
        return ["value", _name_of(type(value)), [[k, _written(v, arrays)] for k, v in content]]
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return ["named", _name_of(type(value)), [_written(each, arrays) for each in value]]
    if isinstance(value, tuple | list):
        kind = "tuple" if isinstance(value, tuple) else "list"
        return [kind, [_written(each, arrays) for each in value]]
    if isinstance(value, Mapping):
        return ["dict", [[_written(k, arrays), _written(v, arrays)] for k, v in value.items()]]
    if isinstance(value, set | frozenset):
        # A set has no order of its own: equal sets must give equal text.
        return [type(value).__name__, sorted((_written(each, arrays) for each in value), key=str)]
    raise TypeError(f"{type(value).__name__} cannot be kept")


def _read(content: Any, arrays: list[AnyArray]) -> Any:
    if not isinstance(content, list):
        return content
    kind, *rest = content
    if kind in ("array", "scalar"):
        array = arrays[rest[0]]
        return array if kind == "array" else array[()]
    if kind == "path":
        return Path(rest[0])
    if kind == "enum":
        return _class(rest[0])[rest[1]]
    if kind == "value":
        given = {name: _read(each, arrays) for name, each in rest[1]}
        return _class(rest[0])(**given)
    if kind == "dict":
        return {_read(key, arrays): _read(each, arrays) for key, each in rest[0]}
    items = [_read(each, arrays) for each in rest[-1]]
    if kind == "named":
        return _class(rest[0])(*items)
    return {"tuple": tuple, "list": list, "set": set, "frozenset": frozenset}[kind](items)


def _name_of(kind: type) -> str:
    """Return the name by which `_class` finds a class of this program."""
    if kind.__module__.partition(".")[0] not in _PACKAGES:
        raise TypeError(f"{kind.__module__}.{kind.__qualname__} cannot be kept")
    return f"{kind.__module__}:{kind.__qualname__}"


@cache
def _class(name: str) -> Any:
    """Return a class by its name; only values and enums of this program, as files name them."""
    module, _, qualified = name.partition(":")
    if module.partition(".")[0] not in _PACKAGES:
        raise ValueError(f"{name} is no class of this program")
    found: Any = import_module(module)
    for part in qualified.split("."):
        found = getattr(found, part)
    plain = isinstance(found, type) and (is_dataclass(found) or issubclass(found, Enum | tuple))
    if not plain:
        raise ValueError(f"{name} is no value of this program")
    return found
