"""Does the steps of calls: over HTTP (httpx), or in this process for a local folder."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Iterator, Mapping
from contextlib import AbstractAsyncContextManager, AbstractContextManager
from typing import Any, TypeAlias

from fusion.client.steps import (
    Answer,
    Compute,
    Effect,
    LostConnectionError,
    NextLine,
    Open,
    Pause,
    Request,
    Send,
)
from spcola.errors import SettingsError

try:
    import httpx
except ImportError as error:
    raise SettingsError(
        "needs httpx", "fusion.client", "install it: pip install 'spcola[client]'"
    ) from error

_TIMEOUT = httpx.Timeout(60.0, connect=10.0)
# The server shows every 15 s that a stream lives.
_STREAM_TIMEOUT = httpx.Timeout(45.0, connect=10.0)
_NOT_SENT = (httpx.ConnectError, httpx.ConnectTimeout, httpx.PoolTimeout)
_Stream: TypeAlias = AbstractContextManager[httpx.Response]
_AsyncStream: TypeAlias = AbstractAsyncContextManager[httpx.Response]


def blocking_client(url: str, token: str) -> httpx.Client:
    """Return a client of httpx for a server."""
    return httpx.Client(**_options(url, token))


def awaiting_client(url: str, token: str) -> httpx.AsyncClient:
    """Return an asynchronous client of httpx for a server."""
    return httpx.AsyncClient(**_options(url, token))


def _options(url: str, token: str) -> dict[str, Any]:
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    # A token is sent to this address alone: redirections are not followed.
    return {"base_url": url, "headers": headers, "timeout": _TIMEOUT, "follow_redirects": False}


class HttpDoing:
    """Does the effects of one call over HTTP."""

    def __init__(self, client: httpx.Client) -> None:
        self._client = client
        self._stream: _Stream | None = None
        self._lines: Iterator[str] = iter(())

    def perform(self, effect: Effect) -> Any:
        """Do an effect and return its outcome."""
        if isinstance(effect, Pause):
            return time.sleep(effect.seconds)
        if isinstance(effect, Compute):
            return effect.function()
        try:
            if isinstance(effect, Send):
                return _answer(self._client.request(**_request(effect.request)))
            if isinstance(effect, NextLine):
                return next(self._lines, None)
            return self._opened(effect)
        except httpx.TransportError as error:
            raise _lost(error) from error

    def _opened(self, effect: Open) -> Answer:
        self.close()
        request = _request(effect.request)
        self._stream = self._client.stream(**request, timeout=_STREAM_TIMEOUT)
        response = self._stream.__enter__()
        if response.is_error:
            response.read()
            return _answer(response)
        self._lines = response.iter_lines()
        return Answer(response.status_code, response.headers)

    def close(self) -> None:
        """Close the stream that is open."""
        if self._stream is not None:
            self._stream.__exit__(None, None, None)
            self._stream, self._lines = None, iter(())


class HttpDoingAsync:
    """Does the effects of one call over HTTP, while others go on."""

    def __init__(self, client: httpx.AsyncClient) -> None:
        self._client = client
        self._stream: _AsyncStream | None = None
        self._lines: AsyncIterator[str] | None = None

    async def perform(self, effect: Effect) -> Any:
        """Do an effect and return its outcome."""
        if isinstance(effect, Pause):
            return await asyncio.sleep(effect.seconds)
        if isinstance(effect, Compute):
            return await asyncio.to_thread(effect.function)
        try:
            if isinstance(effect, Send):
                return _answer(await self._client.request(**_request(effect.request)))
            if isinstance(effect, NextLine):
                return None if self._lines is None else await anext(self._lines, None)
            return await self._opened(effect)
        except httpx.TransportError as error:
            raise _lost(error) from error

    async def _opened(self, effect: Open) -> Answer:
        await self.close()
        request = _request(effect.request)
        self._stream = self._client.stream(**request, timeout=_STREAM_TIMEOUT)
        response = await self._stream.__aenter__()
        if response.is_error:
            await response.aread()
            return _answer(response)
        self._lines = aiter(response.aiter_lines())
        return Answer(response.status_code, response.headers)

    async def close(self) -> None:
        """Close the stream that is open."""
        if self._stream is not None:
            await self._stream.__aexit__(None, None, None)
            self._stream, self._lines = None, None


def _request(request: Request) -> Mapping[str, Any]:
    """Return the arguments of httpx for a request."""
    return {
        "method": request.method,
        "url": request.path,
        "params": dict(request.query) or None,
        "headers": dict(request.headers),
        "json": request.json,
        "content": request.body,
    }


def _answer(response: httpx.Response) -> Answer:
    return Answer(response.status_code, response.headers, response.content)


def _lost(error: httpx.TransportError) -> LostConnectionError:
    reason = str(error) or type(error).__name__
    return LostConnectionError(reason, sent=not isinstance(error, _NOT_SENT))
