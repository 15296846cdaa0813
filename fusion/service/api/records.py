"""What is recorded of every request: a number, a line in the log, and metrics."""

from __future__ import annotations

import logging
import time
import uuid
from typing import Any

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, ProcessCollector
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from fusion.service.jobs import Event, JobState
from fusion.service.tracing import Span, begin_span, end_span

_LOG = logging.getLogger("spcola.service")
_FAILURE = 500
_ENDED = {state.value for state in JobState if state.ended}


class Metrics:
    """The service's own counters, in a registry of their own."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        self.requests = Counter(
            "spcola_requests", "Requests.", ("method", "route", "status"), registry=self.registry
        )
        self.seconds = Histogram(
            "spcola_request_seconds",
            "Time until the whole answer was sent.",
            ("method", "route"),
            registry=self.registry,
            buckets=(0.005, 0.02, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0),
        )
        self.upload_bytes = Counter(
            "spcola_upload_bytes", "Bytes received in uploads.", registry=self.registry
        )
        self.streams = Gauge(
            "spcola_event_streams", "Open streams of events.", registry=self.registry
        )
        self.ended = Counter(
            "spcola_jobs_ended",
            "Jobs that ended since the start: finished, cancelled, or the code of the error.",
            ("outcome",),
            registry=self.registry,
        )
        ProcessCollector(registry=self.registry)

    def count_event(self, event: Event) -> None:
        """Count a job that has ended."""
        state = event.content.get("state") if event.kind == "state" else None
        if state in _ENDED:
            error = event.content.get("error") or {}
            self.ended.labels(error.get("code") or state).inc()


def request_id(request: Request) -> str:
    """Return the number of a request, which its log line and its problem document have."""
    return str(request.scope.get("state", {}).get("request_id", ""))


class Recorded:
    """Middleware that gives a request a number, and records it when it has been answered."""

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self.app = app
        self.metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        number = uuid.uuid4().hex[:16]
        scope.setdefault("state", {})["request_id"] = number
        begun, status = time.monotonic(), 0
        headers = {name: value for name, value in Headers(scope=scope).items() if "trace" in name}
        span = begin_span(scope["method"], {"url.path": scope["path"]}, trace=headers)

        async def numbered(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                MutableHeaders(scope=message)["X-Request-ID"] = number
            await send(message)

        try:
            await self.app(scope, receive, numbered)
        finally:
            self._record(scope, status, time.monotonic() - begun, span)

    def _record(self, scope: Scope, status: int, seconds: float, span: Span) -> None:
        # A path as it was asked for would make a series of its own of every file and job.
        route = getattr(scope.get("route"), "path", "none")
        self.metrics.requests.labels(scope["method"], route, str(status)).inc()
        self.metrics.seconds.labels(scope["method"], route).observe(seconds)
        caller = scope["state"].get("caller")
        fields = {
            "request": scope["state"]["request_id"],
            "method": scope["method"],
            "path": scope["path"],
            "status": status,
            "seconds": round(seconds, 4),
            "user": getattr(caller, "name", ""),
            "address": (scope.get("client") or ("",))[0],
        }
        _LOG.info("request", extra=fields)
        if span is not None:
            span.update_name(f"{scope['method']} {route}")
            failed: dict[str, Any] = {"error": str(status)} if status >= _FAILURE else {}
            end_span(span, status=status, request=fields["request"], user=fields["user"], **failed)
