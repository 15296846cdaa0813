"""How a worker works."""

from __future__ import annotations

from dataclasses import dataclass, field

from fusion.runtime.processes import ProcessLimits
from spcola.errors import InvalidValueError


@dataclass(frozen=True)
class WorkOptions:
    """Limits and intervals of a worker.

    Parameters
    ----------
    threads : int, optional
        Items that are worked on at a time, each in a process; by default one for each core.
    cluster : str
        Address of a Dask scheduler that does the items of runs instead.
    limits : ProcessLimits
        Memory and time for each file that a user uploaded.
    tries : int
        Processes that one item may end before the job fails.
    lease_s, renew_s : float
        A job whose worker shows no sign of life for `lease_s` is given to another; its lease is
        renewed, with its progress, every `renew_s`.
    poll_s : float
        Interval of looks into the queue while there is nothing to do.
    disk_wait_s, cluster_wait_s, busy_wait_s : float
        When a job is tried again that met a full disk, a lost scheduler, or another program in its
        workspace.

    Raises
    ------
    InvalidValueError
        If a lease would end before it is renewed, or an interval is not positive.
    """

    threads: int | None = None
    cluster: str = ""
    limits: ProcessLimits = field(default_factory=ProcessLimits)
    tries: int = 3
    lease_s: float = 30.0
    renew_s: float = 2.0
    poll_s: float = 0.5
    disk_wait_s: float = 60.0
    cluster_wait_s: float = 30.0
    busy_wait_s: float = 10.0

    def __post_init__(self) -> None:
        intervals = (
            self.renew_s,
            self.poll_s,
            self.disk_wait_s,
            self.cluster_wait_s,
            self.busy_wait_s,
        )
        if min(intervals) <= 0.0 or self.tries < 1 or not self.renew_s <= self.lease_s / 3.0:
            raise InvalidValueError(
                "are not positive, or a lease would end before it is renewed", "options of work"
            )
