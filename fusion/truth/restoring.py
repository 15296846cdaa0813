"""Settings back from JSON: nested frozen dataclasses, built by their annotations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from spcola.errors import SettingsError

Kind = TypeVar("Kind")


def restored(kind: type[Kind], values: Any, where: str = "settings") -> Kind:
    """Return the dataclass `kind` from what :func:`dataclasses.asdict` and JSON made of it.

    Lists become tuples, inner mappings dataclasses, as the annotations say. The dataclasses check
    their values themselves.

    Parameters
    ----------
    kind : type
        A dataclass.
    values : mapping
        Entries by the fields' names: all of them, and no others.
    where : str
        What an error names.

    Raises
    ------
    SettingsError
        If an entry is missing, unknown, or not of its type.
    """
    if not isinstance(values, Mapping):
        raise SettingsError("is not a table of entries", where)
    plain: Any = kind  # that it is a dataclass, annotations cannot say
    hints = get_type_hints(kind)
    names = [field.name for field in fields(plain) if field.init]
    for name in names:
        if name not in values:
            raise SettingsError(f"lacks the entry {name}", where)
    for name in values:
        if name not in names:
            raise SettingsError(f"has the unknown entry {name}", where)
    return kind(**{name: _value(hints[name], values[name], f"{where}.{name}") for name in names})


def _value(hint: Any, value: Any, where: str) -> Any:
    """Return one entry in the type that its annotation names."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        if value is None and NoneType in inner:
            return None
        (hint,) = (kind for kind in inner if kind is not NoneType)
        return _value(hint, value, where)
    if origin is Literal:
        if value not in inner:
            raise SettingsError(f"must be one of {', '.join(map(str, inner))}", where)
        return value
    if is_dataclass(hint) and isinstance(hint, type):
        return restored(hint, value, where)
    if origin is tuple:
        if not isinstance(value, list | tuple):
            raise SettingsError("is not a list", where)
        kinds = [inner[0]] * len(value) if inner[-1:] == (Ellipsis,) else inner
        if len(kinds) != len(value):
            raise SettingsError(f"needs {len(kinds)} values, not {len(value)}", where)
        return tuple(_value(kind, x, where) for kind, x in zip(kinds, value, strict=True))
    return _number(hint, value, where)


def _number(hint: Any, value: Any, where: str) -> Any:
    """Check a plain value: a number, a truth value or a word."""
    wanted = {float: (int, float), int: (int,), bool: (bool,), str: (str,)}.get(hint)
    # True is an int to Python, but no number to anybody else.
    mistaken = isinstance(value, bool) and hint is not bool
    if wanted is not None and (mistaken or not isinstance(value, wanted)):
        raise SettingsError(f"must be a {hint.__name__}, not {value!r}", where)
    return float(value) if hint is float else value
