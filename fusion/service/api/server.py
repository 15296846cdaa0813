"""The server process: a socket, the application, and an orderly end."""

from __future__ import annotations

import errno
import signal
import socket
import sys
from collections.abc import Callable

import uvicorn

from fusion.service.api.app import create_app
from fusion.service.api.guard import Entrance
from fusion.service.api.protocol import LimitedProtocol
from fusion.service.api.service import Service
from spcola.errors import SpcolaError

_GRACE_S = 10
_IDLE_S = 65
_BACKLOG = 2048
# A thread that draws a tile may keep the interpreter for five milliseconds by default, and every
# other request waits for it at each of its steps.
_SWITCH_S = 5e-4
_ADVICE = {
    errno.EADDRINUSE: "choose another --port, or stop what uses it",
    errno.EACCES: "choose a --port from 1024 on",
}


def listening(host: str, port: int) -> socket.socket:
    """Return a socket that listens on an address; port 0 takes a free one.

    Raises
    ------
    SpcolaError
        If the address is not this machine's, or in use.
    """
    where = f"{host}:{port}"
    try:
        kind, _, protocol, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        # Only where the protocol is named does asyncio set TCP_NODELAY: without that each answer
        # of two packets waits 40 ms for the other side's delayed acknowledgement.
        opened = socket.socket(kind, socket.SOCK_STREAM, protocol)
    except OSError as error:
        raise SpcolaError(f"is no address ({error.strerror})", where, "check --host") from error
    try:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        opened.bind(address)
        opened.listen(_BACKLOG)
    except OSError as error:
        opened.close()
        do = _ADVICE.get(error.errno or 0, "check --host")
        raise SpcolaError(f"cannot be used ({error.strerror})", where, do) from error
    return opened


class _Server(uvicorn.Server):
    """Ends the streams of events before it waits for the connections to close."""

    def __init__(self, config: uvicorn.Config, service: Service, started: Callable[[], None]):
        super().__init__(config)
        self._service = service
        self._started = started

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        self._started()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        await self._service.feed.close()
        await super().shutdown(sockets)


def run_server(
    service: Service,
    entrance: Entrance,
    opened: socket.socket,
    *,
    started: Callable[[], None] = lambda: None,
) -> None:
    """Answer requests until SIGTERM or Ctrl-C; what is being answered then is finished.

    Parameters
    ----------
    service : Service
    entrance : Entrance
    opened : socket
        From :func:`listening`.
    started : callable
        Called when requests are answered.
    """
    config = uvicorn.Config(
        create_app(service, entrance),
        log_config=None,
        access_log=False,
        server_header=False,
        # Behind a proxy on this machine, address and scheme of a request are what it says.
        proxy_headers=entrance.behind_proxy,
        forwarded_allow_ips="127.0.0.1,::1",
        timeout_keep_alive=_IDLE_S,
        timeout_graceful_shutdown=_GRACE_S,
        lifespan="on",
        http=LimitedProtocol,
        ws="none",
    )
    # uvicorn raises a signal again when it has ended: by then the work is not done.
    usual = sys.getswitchinterval()
    sys.setswitchinterval(_SWITCH_S)
    former = [signal.signal(one, lambda *_: None) for one in (signal.SIGTERM, signal.SIGINT)]
    try:
        _Server(config, service, started).run([opened])
    finally:
        sys.setswitchinterval(usual)
        signal.signal(signal.SIGTERM, former[0])
        signal.signal(signal.SIGINT, former[1])
