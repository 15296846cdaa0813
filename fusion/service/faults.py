"""What an error means to the service: one table of codes, for jobs and for answers over HTTP."""

from __future__ import annotations

from collections.abc import Mapping
from http import HTTPStatus
from typing import NamedTuple

from fusion.runtime.children import PoisonousItemError
from spcola.errors import (
    FormatError,
    FrameMismatchError,
    InvalidValueError,
    KernelError,
    NotObservableError,
    RejectedResultError,
    SettingsError,
    SpcolaError,
    WorkspaceError,
)

__all__ = ["FAULTS", "INTERNAL", "Fault", "error_class", "fault_codes", "fault_of"]


class Fault(NamedTuple):
    """Status of an answer, and the code that programs act on."""

    status: HTTPStatus
    code: str


INTERNAL = Fault(HTTPStatus.INTERNAL_SERVER_ERROR, "internal")
FAULTS: Mapping[type[Exception], Fault] = {
    PoisonousItemError: Fault(HTTPStatus.UNPROCESSABLE_ENTITY, PoisonousItemError.code),
    FormatError: Fault(HTTPStatus.UNPROCESSABLE_ENTITY, "format"),
    SettingsError: Fault(HTTPStatus.UNPROCESSABLE_ENTITY, "settings"),
    FrameMismatchError: Fault(HTTPStatus.UNPROCESSABLE_ENTITY, "frame-mismatch"),
    InvalidValueError: Fault(HTTPStatus.UNPROCESSABLE_ENTITY, "invalid-value"),
    NotObservableError: Fault(HTTPStatus.UNPROCESSABLE_ENTITY, "not-observable"),
    KernelError: Fault(HTTPStatus.UNPROCESSABLE_ENTITY, "kernels"),
    RejectedResultError: Fault(HTTPStatus.CONFLICT, "rejected-result"),
    WorkspaceError: Fault(HTTPStatus.CONFLICT, "workspace"),
    SpcolaError: Fault(HTTPStatus.UNPROCESSABLE_ENTITY, "error"),
    MemoryError: Fault(HTTPStatus.SERVICE_UNAVAILABLE, "out-of-memory"),
}


def fault_of(error: Exception) -> Fault:
    """Return the fault of the nearest class among an error's bases; `INTERNAL` if none is."""
    return next((FAULTS[kind] for kind in type(error).__mro__ if kind in FAULTS), INTERNAL)


def fault_codes() -> set[str]:
    """Return all codes."""
    return {INTERNAL.code, *(fault.code for fault in FAULTS.values())}


def error_class(code: str) -> type[SpcolaError] | None:
    """Return the class of errors of a code that is made of texts alone; None if there is none."""
    found = (kind for kind, fault in FAULTS.items() if fault.code == code)
    plain = (kind for kind in found if issubclass(kind, SpcolaError))
    return next((kind for kind in plain if kind is not PoisonousItemError), None)
