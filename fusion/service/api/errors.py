"""What is wrong with a request, each with the code that programs act on."""

from __future__ import annotations

from enum import StrEnum

from spcola.errors import SpcolaError


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
