"""What is wrong with a request, each with the code that programs act on."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from http import HTTPStatus
from typing import Any

from fusion.service.faults import error_class
from fusion.service.store import StoreError, StoreFault, UnknownJobError
from spcola.errors import SpcolaError

__all__ = ["CODES", "Refusal", "RequestRefusedError", "error_of"]


class Refusal(StrEnum):
    """Why a request is refused."""

    UNAUTHENTICATED = "unauthenticated"
    FORBIDDEN = "forbidden"
    WRONG_HOST = "wrong-host"
    CROSS_SITE = "cross-site"
    NOT_FOUND = "not-found"
    METHOD_NOT_ALLOWED = "method-not-allowed"
    NOT_ACCEPTABLE = "not-acceptable"
    CONFLICT = "conflict"
    WRONG_OFFSET = "wrong-offset"
    WRONG_CHECKSUM = "wrong-checksum"
    TOO_LARGE = "too-large"
    OVER_QUOTA = "over-quota"
    UNSUPPORTED_MEDIA = "unsupported-media-type"
    RANGE_NOT_SATISFIABLE = "range-not-satisfiable"
    INVALID = "invalid-request"
    TOO_MANY = "too-many-requests"
    DISK_FULL = "disk-full"
    UNAVAILABLE = "unavailable"


class RequestRefusedError(SpcolaError):
    """A request that is refused by the service itself.

    Parameters
    ----------
    code : Refusal
    what : str
    where, do : str, optional
        As of `SpcolaError`.
    retry_after_s : float, optional
        When the same request may succeed.
    """

    def __init__(
        self,
        code: Refusal,
        what: str,
        where: str | None = None,
        do: str | None = None,
        *,
        retry_after_s: float | None = None,
    ) -> None:
        self.code = code
        self.retry_after_s = retry_after_s
        super().__init__(what, where, do)


CODES: dict[StrEnum, HTTPStatus] = {
    Refusal.UNAUTHENTICATED: HTTPStatus.UNAUTHORIZED,
    Refusal.FORBIDDEN: HTTPStatus.FORBIDDEN,
    Refusal.WRONG_HOST: HTTPStatus.MISDIRECTED_REQUEST,
    Refusal.CROSS_SITE: HTTPStatus.FORBIDDEN,
    Refusal.NOT_FOUND: HTTPStatus.NOT_FOUND,
    Refusal.METHOD_NOT_ALLOWED: HTTPStatus.METHOD_NOT_ALLOWED,
    Refusal.NOT_ACCEPTABLE: HTTPStatus.NOT_ACCEPTABLE,
    Refusal.CONFLICT: HTTPStatus.CONFLICT,
    Refusal.WRONG_OFFSET: HTTPStatus.CONFLICT,
    Refusal.WRONG_CHECKSUM: HTTPStatus.UNPROCESSABLE_ENTITY,
    Refusal.TOO_LARGE: HTTPStatus.REQUEST_ENTITY_TOO_LARGE,
    Refusal.OVER_QUOTA: HTTPStatus.REQUEST_ENTITY_TOO_LARGE,
    Refusal.UNSUPPORTED_MEDIA: HTTPStatus.UNSUPPORTED_MEDIA_TYPE,
    Refusal.RANGE_NOT_SATISFIABLE: HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE,
    Refusal.INVALID: HTTPStatus.UNPROCESSABLE_ENTITY,
    Refusal.TOO_MANY: HTTPStatus.TOO_MANY_REQUESTS,
    Refusal.DISK_FULL: HTTPStatus.INSUFFICIENT_STORAGE,
    Refusal.UNAVAILABLE: HTTPStatus.SERVICE_UNAVAILABLE,
    StoreFault.UNKNOWN_JOB: HTTPStatus.NOT_FOUND,
    StoreFault.LEASE_LOST: HTTPStatus.CONFLICT,
    StoreFault.KEY_REUSED: HTTPStatus.UNPROCESSABLE_ENTITY,
    StoreFault.UNKNOWN_TOKEN: HTTPStatus.NOT_FOUND,
    StoreFault.REFUSED_TOKEN: HTTPStatus.UNAUTHORIZED,
    StoreFault.UNKNOWN_UPLOAD: HTTPStatus.NOT_FOUND,
    StoreFault.WRONG_OFFSET: HTTPStatus.CONFLICT,
    StoreFault.NEWER_STORE: HTTPStatus.SERVICE_UNAVAILABLE,
    StoreFault.OLDER_STORE: HTTPStatus.SERVICE_UNAVAILABLE,
    StoreFault.DAMAGED: HTTPStatus.SERVICE_UNAVAILABLE,
    StoreFault.DISK_FULL: HTTPStatus.INSUFFICIENT_STORAGE,
    StoreFault.BUSY: HTTPStatus.SERVICE_UNAVAILABLE,
    StoreFault.UNAVAILABLE: HTTPStatus.SERVICE_UNAVAILABLE,
}
"""Status of each code of an error that has one."""


def error_of(problem: Mapping[str, Any], *, retry_after_s: float | None = None) -> SpcolaError:
    """Return the error that a problem document states, as the service raised it.

    Parameters
    ----------
    problem : mapping
        With `code` and `detail`, and perhaps `where` and `do`.
    retry_after_s : float, optional
        When the same request may succeed.
    """
    code = str(problem.get("code", ""))
    what = str(problem.get("detail") or problem.get("title") or "the service refused the request")
    where, do = problem.get("where"), problem.get("do")
    if code in set(StoreFault) - set(Refusal):
        kind = UnknownJobError if code == StoreFault.UNKNOWN_JOB else StoreError
        error = kind.__new__(kind)
        StoreError.__init__(error, StoreFault(code), what, where, do)
        return error
    if code in set(Refusal):
        return RequestRefusedError(Refusal(code), what, where, do, retry_after_s=retry_after_s)
    return (error_class(code) or SpcolaError)(what, where=where, do=do)
