"""Answers: JSON with an ETag, and the choice of a form."""

from __future__ import annotations

import gzip
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from starlette.requests import Request
from starlette.responses import Response

from fusion.runtime import json_value
from fusion.service.api.errors import Refusal, RequestRefusedError
from fusion.service.texts import may_name_paths, without_paths_in

JSON = "application/json"
_PACKED = {JSON, "text/csv"}
# A shorter answer is one packet anyway. Level 5 takes three times as long, for 6 to 8 % less.
_LEAST, _LEVEL = 1024, 2


def json_answer(
    request: Request, content: Mapping[str, Any], headers: Mapping[str, str] | None = None
) -> Response:
    """Return JSON content without paths of the machine, or 304 if the asker has it already."""
    value = json_value(content)
    text = _text(value)
    if may_name_paths(text):
        text = _text(without_paths_in(value, request.app.state.service.root))
    return tagged(request, text.encode("ascii"), JSON, headers)


def described(
    request: Request, content: Mapping[str, Any], headers: Mapping[str, str] | None = None
) -> Response:
    """Return JSON content that describes the interface: its paths are those of routes."""
    return tagged(request, _text(json_value(content)).encode("ascii"), JSON, headers)


def _text(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"))


def tagged(
    request: Request, body: bytes, media_type: str, headers: Mapping[str, str] | None = None
) -> Response:
    """Return bytes with their digest as ETag, or 304 if the asker has them already.

    Long texts are compressed if the asker takes that; their ETag is another one then.
    """
    packed = media_type in _PACKED and len(body) >= _LEAST and _takes_gzip(request)
    tag = f'"{hashlib.sha256(body).hexdigest()[:32]}{"-gzip" * packed}"'
    shared = {
        "ETag": tag,
        "Cache-Control": "private, no-cache",
        "Vary": "Accept, Accept-Encoding, Authorization",
        **(headers or {}),
    }
    if matches(request.headers.get("if-none-match", ""), tag):
        return Response(status_code=304, headers=shared)
    if packed:
        body = gzip.compress(body, _LEVEL, mtime=0)
        shared["Content-Encoding"] = "gzip"
    return Response(body, media_type=media_type, headers=shared)


def by_tag(
    request: Request,
    etag: str,
    media_type: str,
    read: Callable[[], bytes],
    headers: Mapping[str, str] | None = None,
) -> Response:
    """Return bytes that an ETag stands for; they are not read if the asker has them already."""
    tag = f'"{etag}"'
    shared = {"ETag": tag, "Cache-Control": "private, no-cache", "Vary": "Authorization"}
    if matches(request.headers.get("if-none-match", ""), tag):
        return Response(status_code=304, headers=shared)
    return Response(read(), media_type=media_type, headers={**shared, **(headers or {})})


def _takes_gzip(request: Request) -> bool:
    """Return whether the header Accept-Encoding names gzip, and not in order to refuse it."""
    for part in request.headers.get("accept-encoding", "").lower().split(","):
        coding, _, quality = part.replace(" ", "").partition(";")
        if coding == "gzip":
            return quality.rstrip("0.") != "q="
    return False


def matches(header: str, tag: str) -> bool:
    """Return whether the header If-None-Match names an ETag."""
    named = [one.strip().removeprefix("W/") for one in header.split(",")]
    return tag in named or "*" in named


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
