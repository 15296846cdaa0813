"""Codes of errors, by which programs recognise them in jobs, problem documents and the client."""

from __future__ import annotations

from collections.abc import Mapping

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

ERROR_CODES: Mapping[type[Exception], str] = {
    FormatError: "format",
    SettingsError: "settings",
    FrameMismatchError: "frame-mismatch",
    InvalidValueError: "invalid-value",
    NotObservableError: "not-observable",
    KernelError: "kernels",
    RejectedResultError: "rejected-result",
    WorkspaceError: "workspace",
    SpcolaError: "error",
}
"""Code of each class of errors; the nearest class among an error's bases counts."""


def error_class(code: str) -> type[SpcolaError] | None:
    """Return the class of errors of a code; None if no class has it."""
    found = (kind for kind, own in ERROR_CODES.items() if own == code)
    return next((kind for kind in found if issubclass(kind, SpcolaError)), None)
