"""How long work over items still takes, from the items that are done."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

# Items found finished take less than this share of the time that the slowest takes for its size.
_KEPT = 0.1


@dataclass
class RemainingTime:
    """Time that items still take.

    The first item of each worker does not count, as its code may be compiled meanwhile; nor do
    items that were found finished: the others may have to be computed.

    Parameters
    ----------
    sizes : sequence of float
        Work in each item, in any unit, in the order in which they are done.
    workers : int
        Items that are worked on at a time.
    """

    sizes: Sequence[float]
    workers: int
    _seconds: list[float] = field(default_factory=list)

    def add(self, seconds: float) -> None:
        """Count the next item as done; `seconds` is the time that its worker took."""
        self._seconds.append(seconds)

    @property
    def seconds(self) -> float:
        """Seconds until all items are done; NaN as long as nothing can be said."""
        done = len(self._seconds)
        left = sum(self.sizes[done:])
        if not left:
            return 0.0
        timed = [
            (each / size, size)
            for each, size in zip(
                self._seconds[self.workers :], self.sizes[self.workers :], strict=False
            )
            if size > 0.0
        ]
        slowest = max((rate for rate, _ in timed), default=math.nan)
        counted = [(rate * size, size) for rate, size in timed if rate >= _KEPT * slowest]
        if not counted:
            return math.nan
        rate = sum(each for each, _ in counted) / sum(size for _, size in counted)
        return rate * left / self.workers
