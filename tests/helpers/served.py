"""A folder of the service for tests, with its store and a worker in this process."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fusion.service.jobs import Job, JobKind, JobRequest
from fusion.service.store import Store, Upload
from fusion.service.work import WorkOptions, work
from fusion.workspace import new_workspace
from lidar.formats.native import write_scan
from lidar.scans import Scan
from spcola.formats.maplets import write_maplet
from spcola.grids import Maplet, MapletGrid

MAPLETS = 20
OPTIONS = WorkOptions(threads=1, lease_s=3.0, renew_s=0.05, poll_s=0.1)


def make_ball(root: Path) -> None:
    """Make a workspace: maplets in a row on hills, under two scans."""
    made = new_workspace(root, body="Ball")
    rng = np.random.default_rng(1)
    for number in range(MAPLETS):
        normal = np.array([1.0, 0.04 * number - 0.4, 0.0])
        normal /= np.linalg.norm(normal)
        grid = MapletGrid.facing(60.0 * normal, normal, 0.3, 24)
        name = f"AA{number:04d}"
        write_maplet(root / "MAPFILES" / f"{name}.MAP", Maplet(name, grid, np.zeros(grid.shape)))
    for number in range(2):
        away = np.column_stack([np.ones(20_000), rng.uniform(-0.45, 0.45, (20_000, 2))])
        away[:, 2] *= 0.3
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        height = 60.0 + 0.4 * np.sin(40 * away[:, 1]) * np.cos(35 * away[:, 2])
        points = height[:, None] * away + 0.03 * rng.normal(size=3)
        scan = Scan.of_points(f"scan{number}", points, body="Ball")
        write_scan(made.scan_path(scan.name), [scan])


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
