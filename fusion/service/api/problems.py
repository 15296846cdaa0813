"""Problem documents (RFC 9457) of errors; `fusion.service.faults` has their codes."""

from __future__ import annotations

import errno
import logging
import math
from collections.abc import Sequence
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from fusion.runtime import json_value
from fusion.service.api.errors import CODES, Refusal, RequestRefusedError
from fusion.service.api.records import request_id
from fusion.service.faults import fault_of
from fusion.service.store import StoreError
from fusion.service.texts import without_paths
from spcola.errors import SpcolaError, printable

MEDIA_TYPE = "application/problem+json"
_LOG = logging.getLogger("spcola.service")
_FULL = {errno.ENOSPC, errno.EDQUOT}


def status_and_code(error: Exception) -> tuple[HTTPStatus, str]:
    """Return the status and the code of an error; 500 of one that no table names."""
    if isinstance(error, RequestRefusedError | StoreError):
        return CODES[error.code], error.code
    if {getattr(each, "errno", None) for each in (error, error.__cause__)} & _FULL:
        return HTTPStatus.INSUFFICIENT_STORAGE, Refusal.DISK_FULL
    return fault_of(error)


def problem_response(request: Request, error: Exception) -> Response:
    """Return the problem document of an error.

    Paths of the machine are cut from its texts. A 500 says only the request's number, under which
    the log has the trace.
    """
    status, code = status_and_code(error)
    content: dict[str, Any] = {"detail": "see the log of the service, under this request's number"}
    if isinstance(error, SpcolaError):
        content = {"detail": error.what, "where": error.where, "do": error.do}
        if status >= HTTPStatus.INTERNAL_SERVER_ERROR:
            # Where the store lies is for the operator: the log has it.
            _LOG.error("%s", error, extra={"request": request_id(request)})
            del content["where"]
    elif status is HTTPStatus.INSUFFICIENT_STORAGE:
        content = {"detail": "no space is left on the disk", "do": "free some, and try again"}
    elif status >= HTTPStatus.INTERNAL_SERVER_ERROR:
        _LOG.error("unexpected error", exc_info=error, extra={"request": request_id(request)})
    root = request.app.state.service.root
    texts = {
        key: printable(without_paths(text, root))
        for key, text in content.items()
        if text is not None
    }
    headers = {"WWW-Authenticate": "Bearer"} if status is HTTPStatus.UNAUTHORIZED else {}
    wait = getattr(error, "retry_after_s", None) or (5.0 if status.value == 503 else None)
    if wait is not None:
        headers["Retry-After"] = str(max(1, math.ceil(wait)))
    return problem_document(request, status, code, headers=headers, **texts)


def problem_document(
    request: Request,
    status: HTTPStatus,
    code: str,
    *,
    headers: dict[str, str] | None = None,
    **content: Any,
) -> Response:
    """Return a problem document of a status, a code, and members such as `detail`."""
    body = {
        "type": f"urn:spcola:problem:{code}",
        "title": status.phrase,
        "status": int(status),
        "code": code,
        "instance": f"urn:spcola:request:{request_id(request)}",
        **content,
    }
    return JSONResponse(json_value(body), int(status), headers, media_type=MEDIA_TYPE)


def add_problem_handlers(app: FastAPI) -> None:
    """Make every error of an application a problem document."""

    async def known(request: Request, error: Exception) -> Response:
        return problem_response(request, error)

    async def invalid(request: Request, error: Exception) -> Response:
        assert isinstance(error, RequestValidationError)
        return problem_response(request, _invalid(request, error.errors()))

    async def http(request: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        status = HTTPStatus(error.status_code)
        code = next((code for code, own in CODES.items() if own is status), Refusal.INVALID)
        detail = printable(str(error.detail))
        headers = dict(error.headers or {})
        do = {"do": f"use {headers['Allow']}"} if "Allow" in headers else {}
        return problem_document(request, status, code, headers=headers, detail=detail, **do)

    app.add_exception_handler(SpcolaError, known)
    app.add_exception_handler(OSError, known)
    app.add_exception_handler(MemoryError, known)
    app.add_exception_handler(RequestValidationError, invalid)
    app.add_exception_handler(HTTPException, http)


def _invalid(request: Request, errors: Sequence[Any]) -> RequestRefusedError:
    """Return what is wrong with a request whose values are not those described."""
    first: dict[str, Any] = (
        errors[0] if errors else {"loc": ("body",), "msg": "is not valid", "type": ""}
    )
    where = ".".join(printable(str(part))[:60] for part in first["loc"])
    what, do = printable(str(first["msg"])), None
    if first["type"] == "json_invalid":
        why = (first.get("ctx") or {}).get("error", "")
        what, where = f"is not JSON: {printable(str(why))} at character {first['loc'][-1]}", "body"
    elif where == "body" and "json" not in request.headers.get("content-type", ""):
        what, do = "is not JSON", "send it with the header Content-Type: application/json"
    return RequestRefusedError(Refusal.INVALID, what, where, do)
