"""Routes of the process itself: whether it lives, whether it can work, and its counters."""

from __future__ import annotations

from prometheus_client import CONTENT_TYPE_LATEST, generate_latest
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

import spcola
from fusion.service.api.access import KNOWN, PUBLIC, READ_ALL, Routes
from fusion.service.api.answers import described
from fusion.service.api.errors import Refusal, RequestRefusedError
from fusion.service.api.schemas import work
from fusion.service.api.service import service_of

routes = Routes("", "process")


@routes.add("GET", "/health", PUBLIC, work.Health, tagged=False)
def health() -> Response:
    """Say that the process lives."""
    return JSONResponse({"status": "ok", "version": spcola.__version__})


@routes.add("GET", "/ready", PUBLIC, work.Ready, tagged=False)
def ready(request: Request) -> Response:
    """Say whether the service can work, and what is wrong with what it needs."""
    checks = service_of(request).checks()
    obstacles = [f"{name}: {checks[name]}" for name in ("store", "folder") if checks[name] != "ok"]
    if obstacles:
        raise RequestRefusedError(
            Refusal.UNAVAILABLE,
            f"not ready ({', '.join(obstacles)})",
            do="try again",
            retry_after_s=5.0,
        )
    return JSONResponse({"status": "ready", "checks": checks})


@routes.add("GET", "/metrics", READ_ALL, work.METRICS, tagged=False)
def metrics(request: Request) -> Response:
    """Return counters of the service, as Prometheus reads them."""
    registry = service_of(request).metrics.registry
    return Response(generate_latest(registry), media_type=CONTENT_TYPE_LATEST)


@routes.add("GET", "/api/v1/openapi.json", KNOWN, work.Interface)
def openapi(request: Request) -> Response:
    """Return the description of this interface."""
    return described(request, request.app.openapi())
