"""How requests are read from a connection: by a parser in C, with a limit of what it may store."""

from __future__ import annotations

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

__all__ = ["LimitedProtocol"]

_MOST_HEAD = 1 << 16
_TOO_LARGE = (
    b"HTTP/1.1 431 Request Header Fields Too Large\r\n"
    b"connection: close\r\ncontent-length: 0\r\n\r\n"
)


class LimitedProtocol(HttpToolsProtocol):
    """Reads requests; ends a connection that sends more than 64 KiB of address and headers.

    The parser itself stores what comes until the headers, or those after a body in parts, are
    complete: whoever is not known yet could fill the memory of the server.
    """

    _head = 0

    def data_received(self, data: bytes) -> None:
        """Parse what came."""
        self._head += len(data)
        super().data_received(data)
        if self._head > _MOST_HEAD and not self.transport.is_closing():
            self.transport.write(_TOO_LARGE)
            self.transport.close()

    def on_headers_complete(self) -> None:
        """Begin to answer: what came until now is not stored any longer."""
        self._head = 0
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        """Hand on a part of the body, whose size the application limits."""
        self._head = 0
        super().on_body(body)

    def on_message_complete(self) -> None:
        """Wait for the next request."""
        self._head = 0
        super().on_message_complete()
