"""Why two clouds cannot be aligned: an error with the code of a finding."""

from __future__ import annotations

from fusion.estimation.verdict import Code, Finding, Severity
from spcola.errors import NotObservableError


class NotAlignedError(NotObservableError):
    """Two clouds cannot be aligned; `code` gives the reason to other programs."""

    def __init__(self, code: Code, what: str, do: str | None = None) -> None:
        self.code = code
        super().__init__(what, do=do)


def refusal(error: NotObservableError) -> Finding:
    """Return an error as the finding that refuses an alignment.

    Errors without a code of their own name parameters that the ground leaves free.
    """
    code = error.code if isinstance(error, NotAlignedError) else Code.NOT_DETERMINED
    text = error.what if error.do is None else f"{error.what} ({error.do})"
    return Finding(code, Severity.REFUSED, text)
