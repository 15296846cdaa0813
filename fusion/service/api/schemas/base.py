"""Models of answers: made from the dataclasses that are sent, or written where there is none."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, get_type_hints

from pydantic import BaseModel, ConfigDict, create_model

__all__ = ["Form", "Media", "Number", "Open", "form_of", "listing"]

Number = float | None
"""A number; null where it is unknown."""


class Form(BaseModel):
    """An object with these keys and no others."""

    model_config = ConfigDict(extra="forbid")


class Open(BaseModel):
    """An object with these keys, and others that depend on what it is about."""

    model_config = ConfigDict(extra="allow")


@dataclass(frozen=True)
class Media:
    """An answer that is no JSON of a model.

    Parameters
    ----------
    types : tuple of str
        Media types; ``*/*`` where the file decides.
    headers : mapping of str to str
        Further headers, and what they say.
    schemas : mapping of str to dict
        JSON schemas by media type; others are bytes.
    """

    types: tuple[str, ...]
    headers: Mapping[str, str] = field(default_factory=dict)
    schemas: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def content(self) -> dict[str, Any]:
        """Return the content in OpenAPI."""
        plain = {"type": "string", "format": "binary"}
        return {one: {"schema": self.schemas.get(one, plain)} for one in self.types}


def form_of(
    *kinds: type[Any], name: str, without: tuple[str, ...] = (), **more: Any
) -> type[BaseModel]:
    """Return the model of dataclasses as they are sent together; NaN is null.

    Parameters
    ----------
    *kinds : type
        Dataclasses.
    name : str
        Of the model.
    without : tuple of str
        Fields that are not sent.
    **more
        Types of further keys.
    """
    found: dict[str, Any] = {}
    for kind in kinds:
        hints = get_type_hints(kind)
        names = (one.name for one in fields(kind) if one.name not in without)
        found |= {one: Number if hints[one] is float else hints[one] for one in names}
    about = (inspect.getdoc(kinds[0]) or "").partition("\n")[0]
    return _model(name, about, found | more)


def listing(key: str, item: Any, **more: Any) -> type[BaseModel]:
    """Return the model of a page of a list: `key` has its items, of a model or type."""
    return _model(f"{key.title()}Page", f"A page of {key}.", {key: list[item], **more})


def _model(name: str, about: str, keys: Mapping[str, Any]) -> type[BaseModel]:
    content: dict[str, Any] = {key: (kind, ...) for key, kind in keys.items()}
    made: type[BaseModel] = create_model(name, __base__=Form, __doc__=about, **content)
    return made
