"""Requests that are answered: repeated where that is safe, errors as the server raised them."""

from __future__ import annotations

import json
import logging
import random
import time
import warnings
from dataclasses import dataclass
from typing import Any

import spcola
from fusion.client.errors import UnreachableError, VersionWarning
from fusion.client.steps import (
    Answer,
    LostConnectionError,
    Open,
    Pause,
    Request,
    Send,
    Steps,
)
from fusion.service.api.errors import Refusal, RequestRefusedError, error_of
from spcola.errors import SpcolaError

_PROBLEM = "application/problem+json"
_SAFE = {"GET", "HEAD", "DELETE"}
_TOO_MANY, _UNAVAILABLE = 429, 503
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 0.2, 5.0
# Someone who waits learns why once a pause is as long as this: 1.4 s after the first try.
_NOTICED_PAUSE_S = 1.0
_LOG = logging.getLogger("spcola.client")


@dataclass
class Asking:
    """Asks one server.

    Parameters
    ----------
    url : str
    patience_s : float
        How long requests are repeated while the server does not answer, or asks to wait.
    version : str
        Of the server; empty as long as it is unknown.
    """

    url: str
    patience_s: float = 60.0
    version: str = ""

    def greet(self) -> Steps[None]:
        """Learn the version of the server, and warn if it is another than that of the client.

        Raises
        ------
        UnreachableError
            If nothing answers, or something else than ``spcola serve``.
        """
        answer = yield from self.ask(Request("GET", "/health"))
        self.version = str(self.parsed(answer).get("version", ""))
        if not self.version:
            raise UnreachableError("is no spcola serve", self.url, "check the address")
        if self.version != spcola.__version__:
            warnings.warn(self._versions(), VersionWarning, stacklevel=2)

    def json(self, request: Request, *, repeat: bool = False) -> Steps[dict[str, Any]]:
        """Return the JSON object that answers a request."""
        return self.parsed((yield from self.ask(request, repeat=repeat)))

    def ask(self, request: Request, *, repeat: bool = False, stream: bool = False) -> Steps[Answer]:
        """Return the answer to a request.

        A request that cannot have reached the server, or that the server refuses for now, is
        repeated. One that got no answer is, if it changes nothing, or `repeat` states that the
        same request again is the same. A warning is logged once if that takes over a second.

        Raises
        ------
        UnreachableError
            If the server does not answer for `patience_s`.
        SpcolaError
            What the server raised.
        """
        until, pause, noticed = time.monotonic() + self.patience_s, _FIRST_PAUSE_S, False
        again = repeat or request.method in _SAFE
        while True:
            try:
                answer: Answer = yield Open(request) if stream else Send(request)
            except LostConnectionError as error:
                if time.monotonic() >= until or (error.sent and not again):
                    raise self._unreachable(error, request) from error
                wait, why = pause, f"does not answer ({error})"
            else:
                if answer.status < 300 or answer.status == 304:
                    return answer
                problem, wait = self._error(answer), _retry_after(answer) or 0.0
                busy = answer.status == _TOO_MANY or (answer.status == _UNAVAILABLE and again)
                if not busy or time.monotonic() + wait > until:
                    raise problem
                wait, why = max(wait, pause), problem.what
            if wait >= _NOTICED_PAUSE_S and not noticed:
                noticed = True
                _LOG.warning("%s: %s; trying for up to %.0f s", self.url, why, self.patience_s)
            yield Pause(wait * random.uniform(0.8, 1.2))
            pause = min(2.0 * pause, _LONGEST_PAUSE_S)

    def check(self, answer: Answer) -> None:
        """Raise what the server raised instead of an answer."""
        if answer.status >= 300 and answer.status != 304:
            raise self._error(answer)

    def parsed(self, answer: Answer) -> dict[str, Any]:
        """Return the JSON object of an answer; raises UnreachableError if it is none."""
        try:
            content: dict[str, Any] = json.loads(answer.body)
        except ValueError as error:
            raise self._no_service(answer) from error
        if not isinstance(content, dict):
            raise self._no_service(answer)
        return content

    def _error(self, answer: Answer) -> SpcolaError:
        """Return the error of an answer, which is a problem document if a service gave it."""
        if answer.headers.get("content-type", "").partition(";")[0] != _PROBLEM:
            return self._no_service(answer)
        try:
            problem = json.loads(answer.body or b"{}")
        except ValueError:
            return self._no_service(answer)
        error = error_of(problem, retry_after_s=_retry_after(answer))
        # A route that one of the two does not have.
        unknown = problem.get("code") in (Refusal.METHOD_NOT_ALLOWED, Refusal.NOT_FOUND)
        if unknown and not error.where and self.version not in ("", spcola.__version__):
            return RequestRefusedError(Refusal.NOT_FOUND, error.what, None, self._versions())
        return error

    def _no_service(self, answer: Answer) -> SpcolaError:
        what = f"answers, but not as spcola serve does (status {answer.status})"
        do = "check the address" if self.version in ("", spcola.__version__) else self._versions()
        return UnreachableError(what, self.url, do)

    def _unreachable(self, error: LostConnectionError, request: Request) -> UnreachableError:
        what = f"does not answer ({error})"
        if error.sent and request.method not in _SAFE:
            do = "it may have done what was asked: look before you ask again"
            return UnreachableError(what, self.url, do)
        return UnreachableError(what, self.url, "check the address, and that spcola serve runs")

    def _versions(self) -> str:
        return (
            f"the server is spcola {self.version}, this client {spcola.__version__}: use the same"
        )


def _retry_after(answer: Answer) -> float | None:
    """Return when the server wants to be asked again, s."""
    text = answer.headers.get("retry-after", "")
    return float(text) if text.isdecimal() else None
