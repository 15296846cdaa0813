"""The errors that reach a user: one line with what is wrong, where, and what to do."""

from __future__ import annotations

from pathlib import Path


class SpcolaError(Exception):
    """An error that the user can correct.

    Parameters
    ----------
    what : str
        What is wrong, in one clause.
    where : str or Path, optional
        File, and line, record or field in it; or the value's name.
    do : str, optional
        What to do about it.
    """

    def __init__(self, what: str, where: str | Path | None = None, do: str | None = None) -> None:
        self.what = what
        self.where = None if where is None else str(where)
        self.do = do
        text = _clipped(what) if where is None else f"{where}: {_clipped(what)}"
        text = text if do is None else f"{text}; {do}"
        super().__init__(printable(text))


def printable(text: str) -> str:
    """Return `text` on one line, with unprintable characters as escapes.

    Messages quote files and their names, which may contain control sequences, or bytes that are
    not UTF-8.
    """
    line = " ".join(text.split())
    if line.isprintable():
        return line
    return "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in line)


def _clipped(what: str) -> str:
    """Return the text without its middle if a quoted file makes it too long."""
    most = 400
    return what if len(what) <= most else f"{what[: most // 2]} ... {what[-most // 4 :]}"


class FormatError(SpcolaError):
    """A file does not follow its format."""


class SettingsError(SpcolaError):
    """A setting is unknown, has the wrong type, or lies outside its range."""


class FrameMismatchError(SpcolaError):
    """Two values in different frames were combined."""


class InvalidValueError(SpcolaError):
    """A value fails its checks (shape, unit vector, finite, positive …)."""


class NotObservableError(SpcolaError):
    """The data do not determine a result; `parameters` names the free ones."""

    def __init__(
        self,
        what: str,
        parameters: tuple[str, ...] = (),
        where: str | Path | None = None,
        do: str | None = None,
    ) -> None:
        self.parameters = parameters
        super().__init__(what, where, do)


class KernelError(SpcolaError):
    """SPICE kernels are missing, do not cover a time, or contradict one another."""


class RejectedResultError(SpcolaError):
    """A result may not be used: it is refused, or doubtful and not accepted by the user."""


class WorkspaceError(SpcolaError):
    """The workspace lacks something, or cannot be read or written."""


class DiskFullError(WorkspaceError):
    """Nothing more can be written: the disk, a quota or the largest file is full."""
