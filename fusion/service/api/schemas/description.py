"""The description of the interface: media types, headers, problems and examples of all routes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from http import HTTPStatus
from pathlib import Path
from typing import Any

from pydantic import BaseModel, Field
from starlette.responses import Response

from fusion.service.api.errors import CODES
from fusion.service.api.schemas.base import Form, Media
from fusion.service.faults import fault_codes

__all__ = ["completed", "examples", "responses_of"]

_EXAMPLES = Path(__file__).with_name("examples.json")
_PROBLEM = "application/problem+json"
_ETAG = "Digest of the answer: sent as If-None-Match, an unchanged one is 304."
_LINK = "Address of the next page, if there is one."
_LOCATION = "Address of what was made."
_MADE = {HTTPStatus.CREATED, HTTPStatus.ACCEPTED}


class Problem(Form):
    """What is wrong with a request (RFC 9457)."""

    type: str = Field(description="urn:spcola:problem: and the code.")
    title: str = Field(description="Phrase of the status.")
    status: int
    code: str = Field(
        description="For programs.",
        json_schema_extra={"enum": [*sorted({*map(str, CODES), *fault_codes()})]},
    )
    instance: str = Field(description="Its number finds the request in the log.")
    detail: str = Field(description="What is wrong.")
    where: str = Field("", description="Where.")
    do: str = Field("", description="What to do.")


def responses_of(
    answer: type[BaseModel] | Media | None, status: int, *, pages: bool, tagged: bool
) -> dict[str, Any]:
    """Return the options of a route in FastAPI that describe its answers.

    Parameters
    ----------
    answer : type or Media, optional
        Model of the JSON; none for an empty answer.
    status : int
        Of the answer if all is well.
    pages : bool
        Whether it is a page of a list.
    tagged : bool
        Whether it has an ETag.
    """
    headers = dict(answer.headers) if isinstance(answer, Media) else {}
    headers |= {"Link": _LINK} if pages else {}
    headers |= {"ETag": _ETAG} if tagged else {}
    headers |= {"Location": _LOCATION} if status in _MADE else {}
    good: dict[str, Any] = {"description": HTTPStatus(status).phrase}
    if headers:
        good["headers"] = {name: _header(text) for name, text in headers.items()}
    found: dict[int | str, Any] = {status: good}
    if tagged:
        found[304] = {"description": "Not changed"}
    for kind in ("4XX", "5XX"):
        found[kind] = {"description": "A problem"}
    if isinstance(answer, Media):
        good["content"] = answer.content()
    if not (isinstance(answer, type) and issubclass(answer, BaseModel)):
        # Otherwise FastAPI adds JSON.
        return {"responses": found, "response_class": Response}
    return {"responses": found, "response_model": answer}


def completed(described: dict[str, Any]) -> dict[str, Any]:
    """Return the description of FastAPI with problem documents and examples of answers."""
    schema = Problem.model_json_schema()
    described["components"]["schemas"]["Problem"] = schema
    described["components"]["responses"] = {
        "Problem": {
            "description": "A problem document (RFC 9457).",
            "content": {
                _PROBLEM: {
                    "schema": {"$ref": "#/components/schemas/Problem"},
                    "example": examples()["problem"],
                }
            },
        }
    }
    for path, methods in described["paths"].items():
        for method, operation in methods.items():
            answers = operation["responses"]
            for kind in ("4XX", "5XX"):
                answers[kind] = {"$ref": "#/components/responses/Problem"}
            example = examples().get(f"{method.upper()} {path}")
            good = next(one for code, one in answers.items() if code.startswith("2"))
            content = good.get("content", {}).get("application/json")
            if example is not None and content is not None:
                content["example"] = example
    return described


@cache
def examples() -> Mapping[str, Any]:
    """Return answers of a real service, shortened, by method and path; and of a problem."""
    found: dict[str, Any] = json.loads(_EXAMPLES.read_text(encoding="utf-8"))
    return found


def _header(text: str) -> dict[str, Any]:
    return {"description": text, "schema": {"type": "string"}}
