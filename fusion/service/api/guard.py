"""What every request passes before a route: host, origin, token, rate; and the safe headers."""

from __future__ import annotations

import ipaddress
import logging
import re
from dataclasses import dataclass
from urllib.parse import urlsplit

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect, Request
from starlette.types import ASGIApp, Message, Receive, Send
from starlette.types import Scope as Connection

from fusion.service.api.access import Caller
from fusion.service.api.errors import Refusal, RequestRefusedError
from fusion.service.api.problems import problem_response
from fusion.service.api.rate import RateLimit
from fusion.service.api.records import request_id
from fusion.service.api.service import Service
from fusion.service.store import AuditEntry, StoreError, StoreFault
from spcola.errors import InvalidValueError

PAGE_POLICY = (
    "default-src 'self'; img-src 'self' data: blob:; worker-src 'self'; object-src 'none'; "
    "style-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
)
_HEADERS = {
    "Content-Security-Policy": PAGE_POLICY,
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
}
_LOG = logging.getLogger("spcola.service")
_YEAR_S = 31_536_000
_SAFE = {"GET", "HEAD", "OPTIONS"}
# What is answered to anybody: the state of the process, and the page, which has no data.
_CLOSED = ("/api/", "/metrics")
_LOOPBACK_NAMES = {"localhost", "127.0.0.1", "::1"}


def is_loopback(host: str) -> bool:
    """Return whether an address reaches this machine alone."""
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"


@dataclass(frozen=True)
class Entrance:
    """Who may enter.

    Parameters
    ----------
    hosts : frozenset of str
        Names under which the service is reached, without ports. A web site whose name its owner
        made this machine's address (DNS rebinding) is none of them.
    token_needed : bool
        Otherwise whoever has none is the local user, who may do everything.
    behind_proxy : bool
        Whether a proxy on this machine says where a request comes from.
    """

    hosts: frozenset[str] = frozenset(_LOOPBACK_NAMES)
    token_needed: bool = False
    behind_proxy: bool = False

    @classmethod
    def of(cls, host: str, names: tuple[str, ...] = ()) -> Entrance:
        """Return who may enter a server on the address `host` that is also called `names`.

        Without a token nobody may, unless the address is this machine's alone and it has no other
        name: a name is that of a proxy in front, through which anybody may come.

        Raises
        ------
        InvalidValueError
            If a name is no name of a host.
        """
        for name in names:
            if not re.fullmatch(r"[A-Za-z0-9._-]+", name):
                do = "give it without scheme, port and path, as spc.example.org"
                raise InvalidValueError("is no name of a host", f"--name {name[:60]!r}", do)
        own = {host.strip("[]")} | set(names)
        return cls(
            frozenset(name.lower() for name in own | _LOOPBACK_NAMES),
            token_needed=bool(names) or not is_loopback(host),
            behind_proxy=bool(names) and is_loopback(host),
        )


class Guard:
    """Middleware that refuses a request before any route sees it."""

    def __init__(self, app: ASGIApp, service: Service, entrance: Entrance) -> None:
        self.app = app
        self.service = service
        self.entrance = entrance
        limits = service.limits
        self.requests = RateLimit(limits.requests_per_s, limits.request_burst)
        # Wrong tokens have a bucket that fills slowly: guessing is hopeless.
        self.failures = RateLimit(limits.failures_per_s, limits.failure_burst)

    async def __call__(self, scope: Connection, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""
        if scope["type"] != "http":
            # There are no web sockets; the server's own start and stop come here.
            if scope["type"] == "lifespan":
                await self.app(scope, receive, send)
            return
        request = Request(scope, receive)

        async def safe(message: Message) -> None:
            if message["type"] == "http.response.start":
                _add_headers(message, secure=scope["scheme"] == "https")
            await send(message)

        try:
            await self._check(request)
        except Exception as error:
            await problem_response(request, error)(scope, receive, safe)
            return
        await self._answer(request, safe)

    async def _answer(self, request: Request, send: Send) -> None:
        """Hand a request on; an error that nobody foresaw is a problem document, too."""
        begun: Message | None = None

        async def noticing(message: Message) -> None:
            nonlocal begun
            begun = begun or message
            await send(message)

        try:
            await self.app(request.scope, request.receive, noticing)
        except ClientDisconnect:
            # Nobody is there to be answered.
            return
        except Exception as error:
            response = problem_response(request, error)
            if begun is not None:
                # The connection has to break, so that nobody takes the half for the whole.
                raise
            await response(request.scope, request.receive, noticing)
        finally:
            if begun is not None and request.method not in _SAFE:
                await run_in_threadpool(self._note, request, begun)

    def _note(self, request: Request, begun: Message) -> None:
        """Write into the audit log what was asked for and what came of it.

        Parts of uploads are not: the beginning and the end are.
        """
        route = request.scope.get("route")
        caller = request.scope["state"].get("caller")
        if caller is None or route is None or request.method == "PATCH":
            return
        given = request.scope.get("path_params", {})
        entry = AuditEntry(
            caller.name,
            route.name,
            given.get("workspace", ""),
            Headers(raw=begun["headers"]).get("location", request.url.path),
            str(begun["status"]),
            caller.address,
            {"request": request_id(request), "token": caller.token.id},
        )
        try:
            self.service.store.audit.add(entry)
        except StoreError as error:
            _LOG.error("not in the audit log: %s", error, extra={"request": request_id(request)})

    async def _check(self, request: Request) -> None:
        self._check_host(request)
        address = request.client.host if request.client else ""
        caller = await self._caller(request, address)
        # Whoever works on this machine without a token can do worse than ask too often.
        local = caller is not None and not caller.token.id
        who = caller.token.id if caller else address
        if wait := 0.0 if local else self.requests.wait_s(who):
            raise RequestRefusedError(
                Refusal.TOO_MANY, "too many requests", do="slow down", retry_after_s=wait
            )
        if caller is None and request.url.path.startswith(_CLOSED):
            raise RequestRefusedError(
                Refusal.UNAUTHENTICATED,
                "a token is needed",
                do="send it: Authorization: Bearer TOKEN",
            )
        if "authorization" not in request.headers:
            _check_origin(request)
        request.scope["state"]["caller"] = caller

    def _check_host(self, request: Request) -> None:
        host = request.headers.get("host", "")
        try:
            name = (urlsplit(f"//{host}").hostname or "").lower()
        except ValueError:
            name = ""
        if name not in self.entrance.hosts:
            raise RequestRefusedError(
                Refusal.WRONG_HOST, f"the service is not called {name!r}", do="spcola serve --name"
            )

    async def _caller(self, request: Request, address: str) -> Caller | None:
        """Return who asks; None if nobody is known."""
        header = request.headers.get("authorization", "")
        if not header:
            return None if self.entrance.token_needed else Caller.local(address)
        kind, _, secret = header.partition(" ")
        given = secret.strip() if kind.lower() == "bearer" else ""
        try:
            token = await self.service.tokens.find(given)
        except StoreError as error:
            refused = error.code is StoreFault.REFUSED_TOKEN
            if refused and (wait := self.failures.wait_s(address)):
                raise RequestRefusedError(
                    Refusal.TOO_MANY, "too many wrong tokens", do="wait", retry_after_s=wait
                ) from error
            raise
        return Caller(token, address)


def _check_origin(request: Request) -> None:
    """Refuse a change that a page of another site asks the user's browser for.

    Whoever sends a token proves thereby that it is not such a page.
    """
    if request.method in _SAFE:
        return
    site = request.headers.get("sec-fetch-site", "none")
    origin = request.headers.get("origin")
    own = origin is None or urlsplit(origin).netloc == request.headers.get("host", "")
    if site not in ("none", "same-origin") or not own:
        raise RequestRefusedError(
            Refusal.CROSS_SITE, "a page of another site asks for a change", do="send a token"
        )


def _add_headers(message: Message, *, secure: bool) -> None:
    headers = MutableHeaders(scope=message)
    for name, value in _HEADERS.items():
        headers.setdefault(name, value)
    if secure:
        headers.setdefault("Strict-Transport-Security", f"max-age={_YEAR_S}; includeSubDomains")
