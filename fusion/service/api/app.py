"""The application: its routes with their rules, behind the guard."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from fastapi import FastAPI

import spcola
from fusion.service.api.access import rules_of
from fusion.service.api.guard import Entrance, Guard
from fusion.service.api.problems import add_problem_handlers
from fusion.service.api.records import Recorded
from fusion.service.api.routes import ROUTES
from fusion.service.api.schemas import completed
from fusion.service.api.service import Service


class _Described(FastAPI):
    """An application whose description has problem documents and examples of answers."""

    def openapi(self) -> dict[str, Any]:
        """Return the description in OpenAPI."""
        if self.openapi_schema is None:
            self.openapi_schema = completed(super().openapi())
        return self.openapi_schema


def create_app(service: Service, entrance: Entrance | None = None) -> FastAPI:
    """Return the application (ASGI) that serves a folder of workspaces.

    Parameters
    ----------
    service : Service
    entrance : Entrance, optional
        Who may enter; by default whoever works on this machine.

    Raises
    ------
    TypeError
        If a route declares no rule.
    """

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        async with service.feed.running():
            yield

    app = _Described(
        title="SPCOLA",
        version=spcola.__version__,
        description="Laser altimetry and stereophotoclinometry of small bodies: workspaces, jobs, "
        "surfaces and results. Every error is a problem document (RFC 9457).",
        openapi_url=None,
        redirect_slashes=False,
        lifespan=lifespan,
        max_body_size=service.limits.body_bytes,
    )
    app.state.service = service
    for routes in ROUTES:
        routes.add_to(app)
    rules_of(app)
    add_problem_handlers(app)
    app.add_middleware(Guard, service=service, entrance=entrance or Entrance())
    app.add_middleware(Recorded, metrics=service.metrics)
    return app
