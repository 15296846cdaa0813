"""Answers: JSON with an ETag, pages of lists, and the choice of a form."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any
from urllib.parse import urlencode

from starlette.requests import Request
from starlette.responses import Response

from fusion.runtime import json_value
from fusion.service.api.errors import Refusal, RequestRefusedError

JSON = "application/json"


def json_answer(
    request: Request, content: Mapping[str, Any], headers: Mapping[str, str] | None = None
) -> Response:
    """Return JSON content, or 304 if the asker has it already."""
    text = json.dumps(json_value(content), separators=(",", ":"))
    return tagged(request, text.encode("ascii"), JSON, headers)


def tagged(
    request: Request, body: bytes, media_type: str, headers: Mapping[str, str] | None = None
) -> Response:
    """Return bytes with their digest as ETag, or 304 if the asker has them already."""
    tag = f'"{hashlib.sha256(body).hexdigest()[:32]}"'
    shared = {"ETag": tag, "Cache-Control": "private, no-cache", "Vary": "Accept, Authorization"}
    shared |= headers or {}
    if matches(request.headers.get("if-none-match", ""), tag):
        return Response(status_code=304, headers=shared)
    return Response(body, media_type=media_type, headers=shared)


def matches(header: str, tag: str) -> bool:
    """Return whether the header If-None-Match names an ETag."""
    named = [one.strip().removeprefix("W/") for one in header.split(",")]
    return tag in named or "*" in named


def page_of(
    request: Request, names: Sequence[str], after: str, limit: int
) -> tuple[list[str], dict[str, str]]:
    """Return the names that follow `after`, at most `limit`, and the header with the next page."""
    later = sorted(name for name in names if name > after)
    shown = later[:limit]
    return shown, next_link(request, "after", shown[-1]) if len(later) > limit else {}


def next_link(request: Request, key: str, value: str) -> dict[str, str]:
    """Return the header that names the next page of a list: the same question with one key set."""
    query = urlencode({**request.query_params, key: value})
    return {"Link": f'<{request.url.path}?{query}>; rel="next"'}


def accepted(request: Request, offered: Sequence[str]) -> str:
    """Return the type among `offered` that the header Accept prefers; the first if it has none.

    Raises
    ------
    RequestRefusedError
        If none of them is accepted.
    """
    wanted: list[tuple[float, int, str]] = []
    for order, part in enumerate(request.headers.get("accept", "*/*").split(",")):
        kind, *parameters = (text.strip().lower() for text in part.split(";"))
        quality = next((p[2:] for p in parameters if p.startswith("q=")), "1")
        try:
            wanted.append((-float(quality), order, kind))
        except ValueError:
            continue
    for less, _, kind in sorted(wanted):
        for one in offered if less < 0 else ():
            if kind in (one, "*/*", f"{one.partition('/')[0]}/*"):
                return one
    raise RequestRefusedError(
        Refusal.NOT_ACCEPTABLE, "is none of the forms there are", "Accept", " or ".join(offered)
    )
