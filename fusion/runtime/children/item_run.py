"""What became of an item, for logs and spans."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class ItemRun:
    """What became of an item.

    Parameters
    ----------
    name : str
    seconds : float
        Of all its tries; on a cluster of the last one. NaN if it is not known.
    deaths : tuple of str
        How each process ended that the item cost.
    error : str
        Class of the error with which it ended; empty if it has a result.
    worker : str
        Address of the worker of a cluster that did it.
    ended : float
        Seconds since 1970, by the clock of that worker; by default now.
    """

    name: str
    seconds: float
    deaths: tuple[str, ...] = ()
    error: str = ""
    worker: str = ""
    ended: float = math.nan
