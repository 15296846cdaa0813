"""Settings back from JSON, and changed by their names: nested frozen dataclasses."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

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
    # Comparisons with NaN are false: the dataclasses would let many through.
    if isinstance(value, float) and math.isnan(value):
        raise SettingsError("must be a number, not nan", where)
    return float(value) if hint is float else value


def changed(settings: Kind, texts: Sequence[str]) -> Kind:
    """Return `settings` with some entries replaced.

    Parameters
    ----------
    settings : dataclass
    texts : sequence of str
        ``PATH=VALUE`` each: names of fields (and positions in lists, from 0) with dots between,
        and the value as TOML writes it (``body.radius=120``, ``imaging.photometry="lambert"``,
        ``campaign.legs.0.local_times_h=[10, 10]``); a bare word is taken as text, ``none`` as
        nothing.

    Raises
    ------
    SettingsError
        If there is no such entry, or its value is not of its type or out of range.
    """
    values = json.loads(json.dumps(asdict(cast(Any, settings))))
    for text in texts:
        path, sign, value = text.partition("=")
        if not (sign and path.strip()):
            raise SettingsError("is not of the form PATH=VALUE", f"--set {text}")
        _put(values, path.strip().split("."), _read(value.strip()), f"--set {text}")
    return restored(type(settings), values)


def _put(values: Any, path: Sequence[str], value: Any, where: str) -> None:
    """Put `value` where the `path` leads in nested tables and lists."""
    *way, last = path
    for step in way:
        values = values[_place(values, step, where)]
    values[_place(values, last, where)] = value


def _place(values: Any, step: str, where: str) -> Any:
    """Return the key or the position that `step` names."""
    if isinstance(values, dict) and step in values:
        return step
    if isinstance(values, list) and step.isdecimal() and int(step) < len(values):
        return int(step)
    if isinstance(values, list):
        raise SettingsError(f"{step} is no position in a list of {len(values)}", where)
    known = f"; known: {', '.join(values)}" if isinstance(values, dict) else ""
    raise SettingsError(f"there is no entry {step}{known}", where)


def _read(text: str) -> Any:
    """Return the value that a text of TOML states; a bare word is text."""
    if text.lower() == "none":
        return None
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text
