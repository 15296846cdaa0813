"""What the routes of the service work on: a folder, its store, and limits."""

from __future__ import annotations

import os
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from starlette.requests import Request

from fusion.service.api.errors import Refusal, RequestRefusedError
from fusion.service.api.events import EventFeed
from fusion.service.api.folder import ServedFolder
from fusion.service.api.measures import LOW_DISK_BYTES, Crew, Measures
from fusion.service.api.recent import RecentAnswers
from fusion.service.api.records import Metrics
from fusion.service.state import STATE_FOLDER, cache_folder
from fusion.service.store import Store
from fusion.service.views.surfaces import LayerCache
from fusion.workspace import Workspace
from spcola.errors import SpcolaError


@dataclass(frozen=True)
class Limits:
    """What one user or request may take.

    Parameters
    ----------
    body_bytes : int
        Of a request that is no upload.
    upload_bytes : int
        Of one uploaded file.
    uploads : int
        Uploads of a workspace that are not imported yet.
    quota_bytes : int
        All of these together.
    user_quota_bytes : int
        Uploads of one user that are not imported yet, in all workspaces.
    outputs_bytes : int
        Outputs of jobs in a workspace; jobs that would write more are refused beyond it.
    requests_per_s, request_burst : float, int
        Of a token or an address, in the long run and at once.
    failures_per_s, failure_burst : float, int
        Wrong tokens from an address.
    streams : int
        Streams of events that are open at once.
    heartbeat_s : float
        How often a stream without events shows that it lives.
    window_pixels : int
        Of a window of a surface.
    """

    body_bytes: int = 1 << 20
    upload_bytes: int = 1 << 38
    uploads: int = 10_000
    quota_bytes: int = 1 << 40
    user_quota_bytes: int = 1 << 40
    outputs_bytes: int = 1 << 38
    requests_per_s: float = 200.0
    request_burst: int = 1000
    failures_per_s: float = 0.2
    failure_burst: int = 10
    streams: int = 200
    heartbeat_s: float = 15.0
    window_pixels: int = 1 << 22


@dataclass
class Service(ServedFolder):
    """A folder of workspaces as it is served.

    Parameters
    ----------
    root : Path
        A workspace, or a folder whose sub-folders are workspaces.
    store : Store
        Jobs, events, tokens, uploads and the audit log.
    limits : Limits
    crew : Crew, optional
        The workers that run with the server.
    """

    store: Store
    limits: Limits = field(default_factory=Limits)
    metrics: Metrics = field(default_factory=Metrics)
    crew: Crew | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        self.metrics.registry.register(Measures(self.root, self.store, self.crew))
        self.feed = EventFeed(self.store, listeners=[self.metrics.count_event])
        self.beginning = threading.Lock()
        self.cache = LayerCache(folder=cache_folder(self.root))
        self.streams = 0
        self._receiving: set[str] = set()
        self._lock = threading.Lock()
        self.tokens = RecentAnswers(self.store.tokens.check)
        self.workspaces_of_jobs = RecentAnswers(self._workspace_of)

    def _workspace_of(self, job: str) -> str:
        return self.store.job(job).request.workspace

    @contextmanager
    def streaming(self) -> Iterator[None]:
        """Count an open stream of events meanwhile."""
        self.streams += 1
        self.metrics.streams.set(self.streams)
        try:
            yield
        finally:
            self.streams -= 1
            self.metrics.streams.set(self.streams)

    @contextmanager
    def receiving(self, upload: str) -> Iterator[None]:
        """Let one request at a time work on an upload; raises RequestRefusedError."""
        with self._lock:
            if upload in self._receiving:
                what = "another request works on this upload"
                raise RequestRefusedError(Refusal.CONFLICT, what, upload, "wait for it")
            self._receiving.add(upload)
        try:
            yield
        finally:
            self._receiving.discard(upload)

    def checks(self) -> dict[str, str]:
        """Return what the service needs, each with ``ok`` or what is wrong.

        Without `store` and `folder` it cannot work.
        """
        found = dict.fromkeys(("store", "folder", "disk", "workers"), "ok")
        try:
            self.store.jobs(limit=1)
        except SpcolaError as error:
            found["store"] = type(error).__name__
        try:
            self.names()
            if not os.access(self.root / STATE_FOLDER, os.R_OK | os.W_OK | os.X_OK):
                found["folder"] = "cannot be written"
            if shutil.disk_usage(self.root).free < LOW_DISK_BYTES:
                found["disk"] = "nearly full"
        except OSError as error:
            found["folder"] = type(error).__name__
        if self.crew is not None and len(self.crew.workers) < self.crew.count:
            found["workers"] = "some are missing"
        return found


def service_of(request: Request) -> Service:
    """Return the service that a request asks."""
    service = request.app.state.service
    assert isinstance(service, Service)
    return service


@contextmanager
def opened_for(request: Request, name: str, solution: str = "") -> Iterator[Workspace]:
    """Open a workspace to read from it; what is not there is answered with 404.

    Raises
    ------
    RequestRefusedError
        If there is no such workspace or solution, or no such thing in it.
    """
    with service_of(request).opened(name, solution) as workspace:
        yield workspace
