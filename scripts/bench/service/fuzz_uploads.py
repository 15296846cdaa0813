"""Mutated files uploaded to a real server and read by its workers: refused in one line, or read.

    python -m scripts.bench.service.fuzz_uploads [--inputs 20] [--seed 0] [--kind laz]

The good files and their mutations are those of `scripts/bench/fuzz.py`. Each input is an upload and
a job. `poisonous`: it ended every process that read it, and was named. `wrong`: any other code, as
an unexpected error or lost workers. `hangs`: the job did not end in time. The last two are to be 0,
and the server answers at the end. Memory is the largest of any process of the workers, the limit
that of `ProcessLimits`; of the server, it is to remain what it was.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
import tempfile
import threading
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import psutil

BENCH = Path(__file__).parents[1]
sys.path[:0] = [str(BENCH), str(BENCH.parents[1] / "tests" / "helpers")]
from fuzz import input_of  # noqa: E402
from fuzz_samples import KINDS, Sample  # noqa: E402
from server_process import ServerProcess  # noqa: E402

from fusion.runtime.processes import ProcessLimits  # noqa: E402
from fusion.workspace import new_workspace  # noqa: E402

WORKSPACES = 4
PATIENCE_S = 180.0
REFUSED = {
    "format",
    "invalid-value",
    "settings",
    "workspace",
    "kernels",
    "error",
    "frame-mismatch",
    "not-observable",
    "rejected-result",
}
CLOUDS = ("ply cloud", "ply cloud binary", "pcd", "pcd binary", "pcd packed")
LIDAR = ("las", "laz", "table", "ola", "nlr", "hayabusa", "hayabusa2", "lola", "lola binary")
TABLE_COLUMNS = {
    **{name: f"{name}_m [m]" for name in ("x", "y", "z")},
    "range": "range_m [m]",
    "time": "utc [utc]",
}
JOBS: dict[str, tuple[str, dict[str, Any]]] = {
    "scan": ("import", {}),
    **{name: ("import", {"format": name.partition(" ")[0]}) for name in LIDAR},
    **{name: ("import", {"format": "cloud", "unit": "m"}) for name in CLOUDS},
    "laz": ("import", {"format": "las"}),
    "table": ("import", {"format": "table", "columns": TABLE_COLUMNS}),
    **{
        name: ("images", {"letter": "A"})
        for name in ("mission fits", "fits image", "pds3", "pds4", "isis", "tiff", "png")
    },
    **{name: ("init", {}) for name in ("map", "lmk", "sum", "nom", "dat", "list")},
    **{name: ("shape", {}) for name in ("icq", "obj", "ply mesh", "ply mesh binary")},
    **{name: ("poses", {}) for name in ("camera file", "text kernel", "star attitudes")},
}
"""What reads a kind of file: the kind of job, and its parameters."""


@dataclass
class Largest(threading.Thread):
    """Watches the memory of the server and of all processes below it, MB."""

    process: int
    server: float = 0.0
    workers: float = 0.0

    def __post_init__(self) -> None:
        super().__init__(daemon=True)

    __hash__ = threading.Thread.__hash__

    def run(self) -> None:
        server = psutil.Process(self.process)
        while server.is_running():
            try:
                self.server = max(self.server, server.memory_info().rss / 1e6)
                for one in server.children(recursive=True):
                    self.workers = max(self.workers, one.memory_info().rss / 1e6)
            except psutil.Error:
                pass
            time.sleep(0.05)


class Uploader:
    """Uploads inputs and submits the jobs that read them."""

    def __init__(self, client: httpx.Client, good: Path) -> None:
        self._client, self._good, self._count = client, good, 0

    def send(self, workspace: str, name: str, content: bytes) -> str:
        """Upload a file; return its id."""
        digest = hashlib.sha256(content).hexdigest()
        new = {"name": name, "size": len(content), "sha256": digest, "kind": "scan"}
        base = f"/api/v1/workspaces/{workspace}/uploads"
        made = self._client.post(base, json=new).raise_for_status().json()["id"]
        head = {"Upload-Offset": "0", "Content-Type": "application/octet-stream"}
        self._client.patch(f"{base}/{made}", content=content, headers=head).raise_for_status()
        self._client.post(f"{base}/{made}/complete").raise_for_status()
        return str(made)

    def submit(self, kind: str, name: str, content: bytes) -> str:
        """Upload an input and submit its job; return the job."""
        self._count += 1
        what, more = JOBS[kind]
        fresh = what in ("init", "shape")
        workspace = f"new{self._count}" if fresh else f"ws{self._count % WORKSPACES}"
        # Every input is a file of its own: one that was read is not read again.
        named = name if fresh else f"i{self._count}{name}"
        upload = self.send(workspace, named, content)
        given: dict[str, Any] = {"uploads": [upload], **more}
        if what == "shape":
            given = {"body": "Ball", "shape": upload, "shape_unit": "m"}
        elif what == "init":
            given["body"] = "Ball"
        elif what == "poses":
            given = self._posed(workspace, kind, upload)
        asked = {"kind": "init" if fresh else "images" if what == "poses" else what}
        jobs = f"/api/v1/workspaces/{workspace}/jobs"
        answer = self._client.post(jobs, json={**asked, "parameters": given})
        return str(answer.raise_for_status().json()["id"])

    def _posed(self, workspace: str, kind: str, upload: str) -> dict[str, Any]:
        """Return parameters of images whose camera, poses or rotation are the input."""
        files = {}
        for part, sample in (("uploads", "png"), ("camera", "camera file"), ("pck", "text kernel")):
            path = next((self._good / sample.replace(" ", "-")).iterdir())
            files[part] = self.send(workspace, f"g{self._count}{path.name}", path.read_bytes())
        poses = b"name,x_m,y_m,z_m,qw,qx,qy,qz\n" + f"g{self._count}a,1000,0,0,1,0,0,0\n".encode()
        files["poses"] = self.send(workspace, f"p{self._count}.csv", poses)
        changed = {"camera file": "camera", "text kernel": "pck", "star attitudes": "poses"}[kind]
        files[changed] = upload
        return {**files, "uploads": [files["uploads"]], "states": "poses", "letter": "A"}


def good_file(sample: Sample, folder: Path) -> Path:
    """Make the good file of a kind, or find it made."""
    folder.mkdir(exist_ok=True)
    return next(iter(sorted(folder.iterdir())), None) or sample.make(folder)


def tried(
    client: httpx.Client, uploader: Uploader, kind: str, options: argparse.Namespace
) -> Counter:
    """Upload the inputs of a kind; return how many had which outcome."""
    path = good_file(KINDS[kind], options.good / kind.replace(" ", "-"))
    name, good = path.name, path.read_bytes()
    jobs = {
        uploader.submit(kind, name, input_of(KINDS[kind], good, kind, options.seed, number)): number
        for number in range(options.inputs)
    }
    counts: Counter[str] = Counter()
    until = time.monotonic() + PATIENCE_S + 10.0 * len(jobs)
    while jobs:
        for job in list(jobs):
            found = client.get(f"/api/v1/jobs/{job}").raise_for_status().json()
            if found["state"] in ("waiting", "running"):
                continue
            number, error = jobs.pop(job), found["error"] or {}
            code = error.get("code", "")
            one_line = "\n" not in error.get("text", "")
            if not error:
                counts["accepted"] += 1
            elif code in REFUSED and one_line:
                counts["refused"] += 1
            elif code == "poisonous-item":
                counts["poisonous"] += 1
                print(f"    poisonous: {kind} {number}: {error['text'][:140]}", flush=True)
            else:
                counts["wrong"] += 1
                print(f"    wrong: {kind} {number}: {code}: {error['text'][:200]}", flush=True)
        if time.monotonic() > until:
            counts["hangs"] += len(jobs)
            break
        time.sleep(0.3)
    return counts


def main() -> int:
    """Upload all inputs and print the table; return 1 if one did what none may."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--inputs", type=int, default=20, help="of each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", action="append", choices=list(JOBS), help="all if not given")
    options = parser.parse_args()
    total: Counter[str] = Counter()
    columns = ("refused", "accepted", "poisonous", "wrong", "hangs")
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        root, options.good = Path(folder, "missions"), Path(folder, "good")
        options.good.mkdir()
        for number in range(WORKSPACES):
            new_workspace(root / f"ws{number}", body="Ball")
        for kind in ("png", "camera file", "text kernel"):
            good_file(KINDS[kind], options.good / kind.replace(" ", "-"))
        server = ServerProcess(root, "--workers", "2")
        largest = Largest(server.process.pid)
        largest.start()
        try:
            with server.client() as client:
                uploader = Uploader(client, options.good)
                print(f"{'kind':18}{'inputs':>8}" + "".join(f"{one:>11}" for one in columns))
                for kind in options.kind or JOBS:
                    counts = tried(client, uploader, kind, options)
                    total += counts
                    shown = "".join(f"{counts[one]:11d}" for one in columns)
                    print(f"{kind:18}{options.inputs:8d}{shown}", flush=True)
                alive = client.get("/health").status_code == 200
                codes = client.get("/metrics").text
        finally:
            server.kill()
    failed = [line for line in codes.splitlines() if 'status="5' in line]
    limit = ProcessLimits().memory_mb
    print(f"{'all':18}{sum(total.values()):8d}" + "".join(f"{total[one]:11d}" for one in columns))
    print(f"largest process of the workers {largest.workers:.0f} MB, limit {limit} MB")
    print(f"server {largest.server:.0f} MB; answers at the end: {alive}; with a 5xx: {len(failed)}")
    bad = total["wrong"] + total["hangs"] + len(failed)
    return int(bad > 0 or not alive or largest.workers > limit)


if __name__ == "__main__":
    sys.exit(main())
