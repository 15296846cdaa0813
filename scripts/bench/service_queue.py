"""Time of the queue's calls with 10,000 jobs in it, with the limit.

Run: python scripts/bench/service_queue.py [URL...]; by default an SQLite file in a temporary folder
(TMPDIR chooses the disk).
Prints median, 99th percentile and largest time of each call.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

from fusion.service.jobs import JobKind, JobProgress, JobRequest, JobState
from fusion.service.store import Store

JOBS = 10_000
LIMIT_MS = 100.0


class Times:
    """Times of calls by name, in milliseconds."""

    def __init__(self) -> None:
        self.of = defaultdict[str, list[float]](list)

    def call(self, name: str, work: Callable[..., Any], *values: Any, **options: Any) -> Any:
        begun = time.perf_counter()
        result = work(*values, **options)
        self.of[name].append(1000.0 * (time.perf_counter() - begun))
        return result

    def print(self) -> None:
        print(f"{'call':<28}{'number':>8}{'median ms':>11}{'p99 ms':>9}{'largest':>9}{'limit':>7}")
        for name, times in self.of.items():
            times.sort()
            p99 = times[int(0.99 * (len(times) - 1))]
            over = "  OVER" if p99 > LIMIT_MS and len(times) > 1 else ""
            print(
                f"{name:<28}{len(times):>8}{times[len(times) // 2]:>11.2f}{p99:>9.2f}"
                f"{times[-1]:>9.2f}{LIMIT_MS:>7.0f}{over}"
            )


def fill(store: Store, times: Times) -> None:
    for n in range(JOBS):
        parameters = {"stages": ["register", "fuse"], "solution": f"s{n % 3}"}
        place, user = f"ws{n % 40}", f"user{n % 12}"
        request = JobRequest(JobKind.RUN, place, user, parameters, key=str(n))
        times.call("submit, filling", store.submit, request)


def use(store: Store, times: Times) -> None:
    for _ in range(200):
        page = times.call("jobs, newest 100", store.jobs, limit=100)
        before = store.jobs(before=page[-1].id, limit=100)[-1].id
        times.call("jobs, a later page", store.jobs, before=before, limit=100)
        times.call("jobs of a workspace", store.jobs, workspaces=["ws7"], limit=100)
        times.call("jobs of a user, waiting", store.jobs, user="user3", states=[JobState.WAITING])
        times.call("job", store.job, before)
        last = times.call("events, the first 1000", store.events)[-1].number
        times.call("events after", store.events, last, limit=100)
        times.call("counts", store.counts)
        job = times.call("claim", store.claim, "w", 60.0)
        for n in range(3):
            progress = JobProgress("fuse", "maplets", n, 3)
            times.call("renew", store.renew, job.id, "w", 60.0, progress)
        times.call("finish", store.finish, job.id, "w", {"fuse": {"maplets": 3}})
        times.call("submit", store.submit, JobRequest(JobKind.RUN, "ws1", "user1"))


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        for url in sys.argv[1:] or [str(Path(folder, "store.sqlite"))]:
            times = Times()
            with Store(url) as store:
                begun = time.perf_counter()
                fill(store, times)
                rate = JOBS / (time.perf_counter() - begun)
                use(store, times)
                times.call("backup", store.backup, Path(folder, f"{id(store)}.sqlite"))
            times.call("open", Store, url).close()
            print(f"{url.partition(':')[0] if '://' in url else 'sqlite'}: {rate:.0f} jobs/s")
            times.print()


if __name__ == "__main__":
    main()
