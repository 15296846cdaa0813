"""A folder of the service for tests, with its store and a worker in this process."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path

from fusion.service.jobs import Job, JobKind, JobRequest
from fusion.service.store import Store, Upload
from fusion.service.work import WorkOptions, work

MAPLETS = 20
OPTIONS = WorkOptions(threads=1, lease_s=3.0, renew_s=0.05, poll_s=0.1)


@dataclass
class Service:
    """The folder of a service and its store."""

    folder: Path
    store: Store

    @property
    def workspace(self) -> Path:
        return self.folder / "ball"

    def submit(self, kind: JobKind = JobKind.RUN, **parameters: object) -> Job:
        return self.submit_to("ball", kind, **parameters)

    def submit_to(self, workspace: str, kind: JobKind, **parameters: object) -> Job:
        return self.store.submit(JobRequest(kind, workspace, "ann", parameters))

    def work(self, **changed: object) -> None:
        """Do all jobs that may begin, in this process."""
        work(
            self.store,
            self.folder,
            replace(OPTIONS, **changed),
            name=f"worker {self.store.events(limit=100_000)[-1].number}",
            upload=self.store.uploads.get,
            idle=lambda: True,
        )

    def upload(self, name: str, content: bytes, workspace: str = "ball") -> str:
        """Return the id of a finished upload."""
        digest = hashlib.sha256(content).hexdigest()
        new = Upload("", workspace, "ann", name, "scan", len(content), digest)
        made = self.store.uploads.add(new)
        path = self.folder / ".service" / "uploads" / made.id / "file" / name
        path.parent.mkdir(parents=True)
        path.write_bytes(content)
        return made.id

    def notes(self, job: Job) -> list[dict[str, object]]:
        return [dict(one.content) for one in self.store.events(job=job.id) if one.kind == "note"]
