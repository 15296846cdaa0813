"""Asks an ASGI application in this process, without a server."""

from __future__ import annotations

import asyncio
from types import TracebackType
from typing import Any, Self

import httpx


class AsgiClient:
    """The methods of `httpx.Client`; each request is answered in a loop of its own."""

    def __init__(self, app: Any, base_url: str = "http://localhost") -> None:
        self.app = app
        self._base_url = base_url
        self._runner = asyncio.Runner()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._runner.close()

    def request(self, method: str, url: str, **options: Any) -> httpx.Response:
        return self._runner.run(self._asked(method, url, **options))

    async def _asked(self, method: str, url: str, **options: Any) -> httpx.Response:
        transport = httpx.ASGITransport(self.app)
        async with httpx.AsyncClient(transport=transport, base_url=self._base_url) as client:
            return await client.request(method, url, **options)

    def __getattr__(self, method: str) -> Any:
        if method not in ("get", "head", "post", "put", "patch", "delete"):
            raise AttributeError(method)

        def asked(url: str, **options: Any) -> httpx.Response:
            return self.request(method.upper(), url, **options)

        return asked
