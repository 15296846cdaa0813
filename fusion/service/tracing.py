"""Spans for a collector of OpenTelemetry, if one is named; without one nothing is imported."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

from spcola.errors import SettingsError

__all__ = ["COLLECTOR_VARIABLE", "Span", "begin_span", "end_span", "start_tracing"]

COLLECTOR_VARIABLE = "OTEL_EXPORTER_OTLP_ENDPOINT"
_TRACES_VARIABLE = "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT"
# The end of the program does not wait longer for a collector that is gone.
_PATIENCE_S = 5.0

Span = Any
"""A span of OpenTelemetry; None where no collector is named."""

_tracer: list[Any] = []


@contextmanager
def start_tracing(name: str) -> Iterator[None]:
    """Send spans of this process to the collector that the environment names; else do nothing.

    Spans are sent in the background. A collector that does not answer costs spans, never work.

    Parameters
    ----------
    name : str
        Of the process: ``server`` or that of a worker.

    Raises
    ------
    SettingsError
        If the collector's address is no URL of HTTP, or the packages are not installed.
    """
    collector = os.environ.get(_TRACES_VARIABLE) or os.environ.get(COLLECTOR_VARIABLE)
    if not collector:
        yield
        return
    provider = _provider(collector, name)
    _tracer[:] = [provider.get_tracer("spcola")]
    try:
        yield
    finally:
        _tracer.clear()
        provider.shutdown()


def begin_span(
    name: str,
    attributes: Mapping[str, Any],
    *,
    parent: Span = None,
    trace: Mapping[str, str] | None = None,
    begun_s: float | None = None,
) -> Span:
    """Begin a span, which has to be ended with ``end()``; None where no collector is named.

    Parameters
    ----------
    name : str
    attributes : mapping
    parent : Span
    trace : mapping, optional
        Headers of a request, which may name the trace of the asker (W3C ``traceparent``).
    begun_s : float, optional
        When it began, seconds since 1970; by default now.
    """
    if not _tracer:
        return None
    from opentelemetry import propagate  # noqa: PLC0415  only if it is used
    from opentelemetry import trace as tracing  # noqa: PLC0415

    context = propagate.extract(trace) if trace else None
    if parent is not None:
        context = tracing.set_span_in_context(parent)
    start = None if begun_s is None else int(begun_s * 1e9)
    return _tracer[0].start_span(name, context=context, attributes=attributes, start_time=start)


def end_span(span: Span, *, ended_s: float | None = None, **attributes: Any) -> None:
    """End a span, if there is one; with an attribute ``error`` it counts as failed.

    Parameters
    ----------
    span : Span
    ended_s : float, optional
        When it ended, seconds since 1970; by default now.
    **attributes
    """
    if span is None:
        return
    from opentelemetry.trace import StatusCode  # noqa: PLC0415

    span.set_attributes({f"spcola.{name}": value for name, value in attributes.items()})
    if "error" in attributes:
        span.set_status(StatusCode.ERROR, str(attributes["error"]))
    span.end(None if ended_s is None else int(ended_s * 1e9))


def _provider(collector: str, name: str) -> Any:
    parts = urlsplit(collector)
    if parts.scheme not in ("http", "https") or not parts.hostname:
        raise SettingsError(
            "is no URL of a collector", COLLECTOR_VARIABLE, "give one as http://127.0.0.1:4318"
        )
    try:
        from opentelemetry.exporter.otlp.proto.http.trace_exporter import (  # noqa: PLC0415
            OTLPSpanExporter,
        )
        from opentelemetry.sdk.resources import Resource  # noqa: PLC0415
        from opentelemetry.sdk.trace import TracerProvider  # noqa: PLC0415
        from opentelemetry.sdk.trace.export import BatchSpanProcessor  # noqa: PLC0415
    except ImportError as error:
        raise SettingsError(
            "needs further packages",
            COLLECTOR_VARIABLE,
            "install them: pip install 'spcola[telemetry]'",
        ) from error
    resource = Resource.create({"service.name": "spcola", "service.instance.id": name})
    provider = TracerProvider(resource=resource)
    provider.add_span_processor(BatchSpanProcessor(OTLPSpanExporter(timeout=_PATIENCE_S)))
    return provider
