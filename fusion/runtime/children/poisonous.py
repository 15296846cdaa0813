"""An item that ends every process that works on it."""

from __future__ import annotations

from pathlib import PurePath
from typing import Any

from spcola.errors import SpcolaError, printable

_LONGEST = 80


class PoisonousItemError(SpcolaError):
    """An item ended as many processes as it has tries.

    Parameters
    ----------
    item : str
        Its name.
    tries : int
    how : str
        How the last process ended.
    do : str
    """

    code = "poisonous-item"

    def __init__(self, item: str, tries: int, how: str, do: str) -> None:
        self.item = item
        super().__init__(f"ended the process that worked on it {tries} times: {how}", item, do)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle it by its texts: between processes its arguments would be others."""
        return _restored, (self.item, self.what, self.do)


def _restored(item: str, what: str, do: str) -> PoisonousItemError:
    error = PoisonousItemError.__new__(PoisonousItemError)
    SpcolaError.__init__(error, what, item, do)
    error.item = item
    return error


def item_name(item: Any) -> str:
    """Return the name of an item of a stage: a name, a file, a value with a name, or one of these.

    Of a tuple, the first part that has a name gives it.
    """
    for part in item if isinstance(item, tuple) else (item,):
        for one in (part, getattr(part, "name", None), getattr(part, "path", None)):
            if isinstance(one, PurePath):
                return printable(one.name)
            if isinstance(one, str) and one:
                return printable(one)
    return printable(repr(item))[:_LONGEST]
