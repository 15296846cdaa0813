"""Values as text and arrays: for a digest of what goes into an item, and for keeping its result."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
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


def _written(value: Any, arrays: list[AnyArray]) -> Any:
    """Return JSON types; all but numbers and text become lists that begin with their type."""
    if value is None or type(value) in (bool, int, float, str):
        return value
    if isinstance(value, np.ndarray | np.generic):
        array = np.asarray(value)
        if array.dtype.hasobject:
            raise TypeError("arrays of objects cannot be kept")
        arrays.append(array)
        return ["array" if isinstance(value, np.ndarray) else "scalar", len(arrays) - 1]
    kind, name, content = _parts(value)
    return [kind, name, [_written(each, arrays) for each in content]]


def _parts(value: Any) -> tuple[str, str, list[Any]]:
    """Return the kind of a value or container, its class where it has one, and what is in it."""
    if is_dataclass(value) and not isinstance(value, type):
        names = [each.name for each in fields(value) if each.init]
        return "value", _name_of(type(value)), [names, *(getattr(value, name) for name in names)]
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return "named", _name_of(type(value)), list(value)
    if isinstance(value, Enum):
        return "enum", _name_of(type(value)), [value.name]
    for kind, content_of in _CONTENT.items():
        if isinstance(value, kind):
            return kind.__name__, "", content_of(value)
    raise TypeError(f"{type(value).__name__} cannot be kept")


# A set has no order of its own: equal sets must give equal text.
_CONTENT: Mapping[type, Callable[[Any], list[Any]]] = {
    Path: lambda value: [str(value)],
    dict: lambda value: [list(value.keys()), list(value.values())],
    MappingProxyType: lambda value: [list(value.keys()), list(value.values())],
    set: lambda value: sorted(value, key=lambda each: encode(each).text),
    frozenset: lambda value: sorted(value, key=lambda each: encode(each).text),
    tuple: list,
    list: list,
}
_MAKERS: Mapping[str, Callable[[str, list[Any]], Any]] = {
    "enum": lambda name, content: _class(name)[content[0]],
    "Path": lambda _, content: Path(content[0]),
    "value": lambda name, content: _class(name)(**dict(zip(content[0], content[1:], strict=True))),
    "named": lambda name, content: _class(name)(*content),
    "dict": lambda _, content: dict(zip(*content, strict=True)),
    "mappingproxy": lambda _, content: MappingProxyType(dict(zip(*content, strict=True))),
    "set": lambda _, content: set(content),
    "frozenset": lambda _, content: frozenset(content),
    "tuple": lambda _, content: tuple(content),
    "list": lambda _, content: content,
}


def _read(content: Any, arrays: list[AnyArray]) -> Any:
    """Return the value of what `_written` returned."""
    if not isinstance(content, list):
        return content
    if content[0] == "array":
        return arrays[content[1]]
    if content[0] == "scalar":
        return arrays[content[1]][()]
    kind, name, parts = content
    return _MAKERS[kind](name, [_read(each, arrays) for each in parts])
