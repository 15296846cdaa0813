"""Filters of Python's warnings while a library reads a file, safe on threads."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

# The filters belong to the process: two threads that change them at the same time would leave
# each other's behind.
_LOCK = threading.RLock()


@contextmanager
def warnings_as(
    action: Literal["error", "ignore"], category: type[Warning] = Warning
) -> Iterator[None]:
    """Turn warnings of a category into errors, or ignore them, in the block.

    One thread at a time is in such a block.

    Parameters
    ----------
    action : {"error", "ignore"}
    category : type
    """
    with _LOCK, warnings.catch_warnings():
        warnings.simplefilter(action, category)
        yield
