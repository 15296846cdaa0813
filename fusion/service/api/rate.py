"""Limits of rate: one bucket of requests for each token or address."""

from __future__ import annotations

import time
from collections import OrderedDict
from dataclasses import dataclass, field

_MOST_BUCKETS = 10_000


@dataclass
class RateLimit:
    """Buckets that fill at a rate and are emptied by requests.

    Parameters
    ----------
    per_second : float
        Requests a second in the long run; 0 is no limit.
    burst : int
        Requests at once.
    """

    per_second: float
    burst: int
    _buckets: OrderedDict[str, tuple[float, float]] = field(default_factory=OrderedDict)

    def wait_s(self, who: str, now: float | None = None) -> float:
        """Take one request from the bucket of `who`; return 0, or the time until it may come.

        Parameters
        ----------
        who : str
        now : float, optional
            A steady clock, s; by default the machine's.
        """
        if self.per_second <= 0:
            return 0.0
        now = time.monotonic() if now is None else now
        left, since = self._buckets.pop(who, (float(self.burst), now))
        left = min(float(self.burst), left + max(0.0, now - since) * self.per_second)
        taken = left >= 1.0
        self._buckets[who] = (left - 1.0 if taken else left, now)
        while len(self._buckets) > _MOST_BUCKETS:
            self._buckets.popitem(last=False)
        return 0.0 if taken else (1.0 - left) / self.per_second
