"""Settings back from JSON, and changed by their names: nested frozen dataclasses."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import cache
from typing import Any, TypeVar, cast

from pydantic import ConfigDict, TypeAdapter, ValidationError

from fusion.workspace.settings import problem_text
from spcola.errors import SettingsError

Kind = TypeVar("Kind")


def restored(kind: type[Kind], values: Any, where: str = "settings") -> Kind:
    """Return the dataclass `kind` from what :func:`dataclasses.asdict` and JSON made of it.

    Lists become tuples and inner tables dataclasses, by the annotations. The dataclasses check
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
    try:
        (found,) = _adapter(cast(Any, kind)).validate_json(json.dumps([values]))
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]
        place = ".".join([where, *map(str, problem["loc"][1:])])
        raise SettingsError(problem_text(problem), place) from error
    for name in _lacking(asdict(found), values):
        raise SettingsError(f"lacks the entry {name}", where)
    return cast(Kind, found)


@cache
def _adapter(kind: type[Any]) -> TypeAdapter[Any]:
    """Return the adapter that checks entries of `kind`; a tuple around it has the options."""
    options = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
    return TypeAdapter(cast(Any, tuple)[kind], config=options)


def _lacking(whole: Any, given: Any) -> Iterator[str]:
    """Yield the entries, names joined by dots, that are missing in `given`."""
    if isinstance(whole, dict):
        for name, value in whole.items():
            inner = _lacking(value, given[name]) if name in given else iter([""])
            yield from (f"{name}.{rest}".rstrip(".") for rest in inner)
    elif isinstance(whole, list | tuple):
        for k, (value, item) in enumerate(zip(whole, given, strict=True)):
            yield from (f"{k}.{rest}" for rest in _lacking(value, item))


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
