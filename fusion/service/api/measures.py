"""What an operator watches: jobs, workers, uploads and the disk at the moment of the question."""

from __future__ import annotations

import math
import shutil
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Protocol

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

import spcola
from fusion.service.store import Store
from fusion.service.store.store import LAST_BACKUP, LAST_CLEANING
from spcola.errors import SpcolaError

LOW_DISK_BYTES = 1 << 30
"""With less than this the disk counts as nearly full."""


class Crew(Protocol):
    """The workers that a server keeps running."""

    @property
    def count(self) -> int:
        """How many there should be."""
        ...

    @property
    def workers(self) -> Mapping[str, int]:
        """The process number of each by its name."""
        ...

    @property
    def ended(self) -> int:
        """How many have ended though they were not to."""
        ...


class Measures(Collector):
    """Gauges that are read when Prometheus asks.

    Parameters
    ----------
    root : Path
    store : Store
    crew : Crew, optional
    """

    def __init__(self, root: Path, store: Store, crew: Crew | None) -> None:
        self._root, self._store, self._crew = root, store, crew

    def collect(self) -> Iterator[Metric]:
        """Yield all gauges; those of a store that does not answer are left out."""
        build = GaugeMetricFamily("spcola_build_info", "The program.", labels=("version",))
        build.add_metric([spcola.__version__], 1.0)
        yield build
        disk = shutil.disk_usage(self._root)
        yield GaugeMetricFamily("spcola_disk_free_bytes", "Of the folder's disk.", disk.free)
        yield GaugeMetricFamily("spcola_disk_bytes", "Of the folder's disk.", disk.total)
        if self._crew is not None:
            yield from _crew_metrics(self._crew)
        up = GaugeMetricFamily("spcola_store_up", "Whether the store answers.")
        try:
            stored = [*self._job_metrics(), *self._upload_metrics(), *self._times()]
        except SpcolaError:
            stored = []
        up.add_metric([], float(bool(stored)))
        yield up
        yield from stored

    def _job_metrics(self) -> Iterator[Metric]:
        jobs = GaugeMetricFamily("spcola_jobs", "Jobs in the store.", labels=("state",))
        for state, count in self._store.counts().items():
            jobs.add_metric([state.value], count)
        yield jobs
        oldest = GaugeMetricFamily(
            "spcola_oldest_job_seconds", "Time since submission or begin.", labels=("state",)
        )
        for state, since in self._store.oldest().items():
            # NaN, as no job is in the state, would raise no alarm and end none.
            oldest.add_metric([state.value], max(0.0, time.time() - since) if since > 0 else 0.0)
        yield oldest

    def _upload_metrics(self) -> Iterator[Metric]:
        kept = self._store.uploads.kept()
        size = sum(upload.size for upload in kept)
        yield GaugeMetricFamily("spcola_uploads", "Uploads that are kept.", len(kept))
        yield GaugeMetricFamily("spcola_uploads_bytes", "Size of kept uploads.", size)

    def _times(self) -> Iterator[Metric]:
        for name in (LAST_BACKUP, LAST_CLEANING):
            metric = f"spcola_{name.replace('-', '_')}_timestamp_seconds"
            when = self._store.noted_time(name)
            known = 0.0 if math.isnan(when) else when
            yield GaugeMetricFamily(metric, "Seconds since 1970; 0 if never.", known)


def _crew_metrics(crew: Crew) -> Iterator[Metric]:
    workers = GaugeMetricFamily("spcola_workers", "Worker processes.", labels=("state",))
    workers.add_metric(["wanted"], crew.count)
    workers.add_metric(["running"], len(crew.workers))
    yield workers
    yield CounterMetricFamily("spcola_workers_ended", "Those that were not to.", crew.ended)
