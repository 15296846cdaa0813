"""Recent answers of the store: a request that needs one of them waits for no thread."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Generic, TypeVar

from starlette.concurrency import run_in_threadpool

__all__ = ["RecentAnswers"]

Answer = TypeVar("Answer")
_REMEMBERED_S = 2.0
_MOST = 1000


class RecentAnswers(Generic[Answer]):
    """What a question about a text was answered with, remembered for two seconds.

    Every request asks who sends it, and a page asks about its job several times a second. Each
    question to the store takes a thread, and one that is busy makes the server wait for it.

    Parameters
    ----------
    ask : callable
        Asks the store. What it raises is not remembered.
    """

    def __init__(self, ask: Callable[[str], Answer]) -> None:
        self._ask = ask
        self._known: dict[str, tuple[float, Answer]] = {}

    async def find(self, about: str) -> Answer:
        """Return the answer about a text; raises what asking the store raises."""
        now, known = time.monotonic(), self._known
        since, *answer = known.get(about, (-math.inf,))
        if answer and now - since < _REMEMBERED_S:
            return answer[0]
        found = await run_in_threadpool(self._ask, about)
        if len(known) >= _MOST:
            known.clear()
        known[about] = (now, found)
        return found

    def forget(self) -> None:
        """Ask the store again about everything, also about what it is being asked now."""
        self._known = {}
