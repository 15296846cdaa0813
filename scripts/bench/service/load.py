"""A server under load: 50 clients while two jobs run, windows of a large bigmap, a long queue, uploads.

    python -m scripts.bench.service.load [--seconds 60] [--clients 50] [--size 5001]
        [--jobs 10000] [--upload-mb 1024]

A real server process with two workers, asked over sockets by client processes. Each client asks
again a quarter of a second after its last answer (as a page does that shows a job and is moved): a
job's state, then three tiles of a bigmap. Each figure is printed with its limit, and the load of
the machine: clients, workers and server share its cores.
"""

from __future__ import annotations

import argparse
import hashlib
import http.client
import json
import multiprocessing
import os
import random
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import psutil

from fusion.service.jobs import JobKind, JobRequest
from fusion.service.store import Store
from scripts.bench.service_views import made

ROOT = Path(__file__).parents[3]
sys.path.insert(0, str(ROOT / "tests" / "helpers"))
from server_process import ServerProcess  # noqa: E402

PAUSE_S = 0.25
WINDOW = 512
BLOCK = 1 << 20
NOTED_EVERY = 1 << 26  # bytes between two fsyncs of an upload
RESULTS: list[bool] = []


def row(title: str, value: float, unit: str, limit: float, *, least: bool = False) -> None:
    """Print a figure and its limit."""
    good = value >= limit if least else value <= limit
    RESULTS.append(good)
    sign = "≥" if least else "≤"
    print(
        f"{title:52} {value:10.1f} {unit:4} {sign} {limit:g}{'' if good else '  MISSED'}",
        flush=True,
    )


@dataclass
class Asker:
    """One connection; `taken` are milliseconds of answers by what was asked for."""

    url: str
    taken: dict[str, list[float]] = field(default_factory=dict)
    errors: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._connection = http.client.HTTPConnection(urlsplit(self.url).netloc, timeout=60)

    def ask(self, what: str, path: str, body: bytes | None = None, method: str = "") -> bytes:
        begun = time.perf_counter()
        head = {"Content-Type": "application/json"} if body else {}
        try:
            self._connection.request(method or ("POST" if body else "GET"), path, body, head)
            answer = self._connection.getresponse()
            content = answer.read()
            status = answer.status
        except (OSError, http.client.HTTPException) as error:
            self._connection.close()
            content, status = repr(error).encode(), 0
        self.taken.setdefault(what, []).append(1e3 * (time.perf_counter() - begun))
        if not 200 <= status < 300:
            self.errors.append(f"{path}: {status} {content[:100]!r}")
        return content


def client_process(url: str, job: str, clients: int, until: float, tiles: list, answers) -> None:
    """Run some clients, each a thread; put their times and errors into a queue."""
    askers = [Asker(url) for _ in range(clients)]

    def use(number: int) -> None:
        rng, asker = random.Random(number), askers[number]
        time.sleep(PAUSE_S * rng.random())
        turn = 0
        while time.monotonic() < until:
            if turn % 4 == 0:
                asker.ask("status", f"/api/v1/jobs/{job}")
            else:
                level, count = rng.choice(tiles)
                place = f"{level}/{rng.randrange(count)}/{rng.randrange(count)}"
                asker.ask(
                    "tile", f"/api/v1/workspaces/maps/surfaces/bigmap/SITE:fused/tiles/{place}"
                )
            turn += 1
            time.sleep(PAUSE_S)

    threads = [threading.Thread(target=use, args=(number,)) for number in range(clients)]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    answers.put([(asker.taken, asker.errors) for asker in askers])


def missions(folder: Path, size: int) -> None:
    """Make a workspace with a large bigmap, and two in which jobs run."""
    made(folder, size)
    (folder / "ws").rename(folder / "maps")
    mission = folder.parent / "mission"
    spcola = [sys.executable, "-m", "fusion.cli"]
    quiet = {"check": True, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": ROOT}
    subprocess.run([*spcola, "truth", "make", mission, "--preset", "tiny"], **quiet)
    one = folder / "one"
    subprocess.run([*spcola, "init", one, "--spc", mission / "spc", "--body", "Truth"], **quiet)
    subprocess.run([*spcola, "import", one, *sorted((mission / "lidar").iterdir())], **quiet)
    shutil.copytree(one, folder / "two", symlinks=True)


class Memory(threading.Thread):
    """Samples the memory of a process, MB."""

    def __init__(self, process: int) -> None:
        super().__init__(daemon=True)
        self._process, self.samples = psutil.Process(process), []
        self.running = True

    def run(self) -> None:
        while self.running:
            self.samples.append(self._process.memory_info().rss / 1e6)
            time.sleep(0.5)


def under_load(server: ServerProcess, options: argparse.Namespace) -> None:
    """Let clients ask while two jobs run."""
    asker = Asker(server.url)
    jobs = []
    for turn in range(1 + int(options.seconds / 20)):
        for name in ("one", "two"):
            body = {"kind": "run", "parameters": {"force": turn > 0}}
            made_job = asker.ask(
                "submit", f"/api/v1/workspaces/{name}/jobs", json.dumps(body).encode()
            )
            jobs.append(json.loads(made_job)["id"])
    described = json.loads(asker.ask("", "/api/v1/workspaces/maps/surfaces/bigmap/SITE:fused"))
    tiles = [(one["level"], one["tiles"]) for one in described["levels"]]
    memory = Memory(server.process.pid)
    memory.start()
    answers = multiprocessing.Queue()
    until = time.monotonic() + options.seconds
    processes = [
        multiprocessing.Process(
            target=client_process,
            args=(server.url, jobs[0], options.clients // 2, until, tiles, answers),
        )
        for _ in range(2)
    ]
    for one in processes:
        one.start()
    running = []
    while time.monotonic() < until:
        time.sleep(2.0)
        found = json.loads(asker.ask("", "/api/v1/jobs?state=running"))["jobs"]
        running.append(len(found))
    each = [pair for _ in processes for pair in answers.get()]
    memory.running = False
    errors = [error for _, wrong in each for error in wrong]
    count = 0
    print(f"jobs that ran meanwhile: {np.mean(running):.1f} on average")
    for what in ("status", "tile"):
        taken = [ms for one, _ in each for ms in one.get(what, [])]
        count += len(taken)
        middle, high = np.percentile(taken, (50, 99))
        print(f"{what}: {len(taken)} requests, median {middle:.1f} ms, longest {max(taken):.0f} ms")
        row(f"{what}, p99 with {options.clients} clients", high, "ms", 250.0)
    row(f"errors in {count} requests ({count / options.seconds:.0f} /s)", len(errors), "", 0)
    for error in errors[:3]:
        print(f"    {error}")
    half = len(memory.samples) // 2
    first, most = max(memory.samples[:half]), max(memory.samples)
    print(
        f"memory of the server: {memory.samples[0]:.0f} MB at first, {memory.samples[-1]:.0f} at last"
    )
    row("memory of the server, most", most, "MB", 1500.0)
    row("its growth in the second half", 100.0 * (most / first - 1.0), "%", 5.0)
    for job in jobs:
        asker.ask("", f"/api/v1/jobs/{job}/cancel", b"{}")


def windows(server: ServerProcess, size: int) -> None:
    """Ask for windows of the bigmap, one after the other."""
    asker, rng = Asker(server.url), random.Random(2)
    for layer in ("height", "sigma", "difference", "hillshade"):
        for _ in range(60):
            low = rng.randrange(size - WINDOW), rng.randrange(size - WINDOW)
            asker.ask(
                layer,
                "/api/v1/workspaces/maps/surfaces/bigmap/SITE:fused/window?"
                f"layer={layer}&row={low[0]}&column={low[1]}&rows={WINDOW}&columns={WINDOW}",
            )
        high = float(np.percentile(asker.taken[layer], 95))
        row(f"window {WINDOW}² of {size}², {layer}, p95", high, "ms", 100.0)
    row("errors in windows", len(asker.errors), "", 0)


def long_queue(folder: Path, jobs: int) -> None:
    """Submit to a queue of many jobs, and list it."""
    with Store(folder / ".service" / "store.sqlite") as store:
        for number in range(jobs):
            store.submit(JobRequest(JobKind.RUN, ("one", "two")[number % 2], f"user{number % 9}"))
    server = ServerProcess(folder, "--workers", "0")
    try:
        asker = Asker(server.url)
        run = json.dumps({"kind": "run", "parameters": {"stages": ["mapolas"]}}).encode()
        for number in range(300):
            asker.ask("submit", "/api/v1/workspaces/one/jobs", run)
            before = f"&before={number * jobs // 300:08d}-0" if number else ""
            asker.ask("list", f"/api/v1/jobs?limit=100{before}")
        for what in ("submit", "list"):
            high = float(np.percentile(asker.taken[what], 99))
            row(f"{what} with {jobs} jobs in the queue, p99", high, "ms", 100.0)
        row("errors", len(asker.errors), "", 0)
    finally:
        server.kill()


def upload(server: ServerProcess, folder: Path, megabytes: int) -> None:
    """Compare the rate of an upload with that of the disk, in turns."""
    content = random.Random(4).randbytes(BLOCK)
    digest = hashlib.sha256()
    for _ in range(megabytes):
        digest.update(content)

    def write() -> None:
        path = folder / "plain"
        with path.open("wb", buffering=0) as stream:
            for number in range(megabytes):
                stream.write(content)
                if (number + 1) % (NOTED_EVERY // BLOCK) == 0:
                    os.fsync(stream.fileno())
            os.fsync(stream.fileno())
        path.unlink()

    def send() -> None:
        asker = Asker(server.url)
        new = {
            "name": "a.las",
            "size": megabytes * BLOCK,
            "sha256": digest.hexdigest(),
            "kind": "scan",
        }
        place = "/api/v1/workspaces/one/uploads"
        identity = json.loads(asker.ask("", place, json.dumps(new).encode()))["id"]
        times.append(seconds(lambda: patch(server.url, f"{place}/{identity}", content, megabytes)))
        asker.ask("complete", f"{place}/{identity}/complete", b"{}")
        completes.append(asker.taken["complete"][-1] / 1e3)
        asker.ask("", f"{place}/{identity}", method="DELETE")
        assert not asker.errors, asker.errors

    times: list[float] = []
    completes: list[float] = []
    plain = []
    for _ in range(3):
        plain.append(seconds(write))
        send()
    disk, sent = megabytes / np.median(plain), megabytes / np.median(times)
    print(
        f"disk {disk:.0f} MB/s, upload {sent:.0f} MB/s, its checksum {np.median(completes):.1f} s"
    )
    row(f"upload of {megabytes} MB, of the disk's rate", 100.0 * sent / disk, "%", 60.0, least=True)


def patch(url: str, path: str, content: bytes, megabytes: int) -> None:
    connection = http.client.HTTPConnection(urlsplit(url).netloc, timeout=600, blocksize=BLOCK)
    head = {
        "Upload-Offset": "0",
        "Content-Type": "application/offset+octet-stream",
        "Content-Length": str(len(content) * megabytes),
    }
    connection.request("PATCH", path, (content for _ in range(megabytes)), head)
    answer = connection.getresponse()
    assert answer.status == 204, answer.read()


def seconds(act: Callable[[], object]) -> float:
    begun = time.perf_counter()
    act()
    return time.perf_counter() - begun


def main() -> int:
    """Print all figures; return 1 if one misses its limit."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--clients", type=int, default=50)
    parser.add_argument("--size", type=int, default=5001)
    parser.add_argument("--jobs", type=int, default=10_000)
    parser.add_argument("--upload-mb", type=int, default=1024)
    parser.add_argument("--work", type=Path, help="a folder that is kept, and used again")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = (options.work or Path(temporary)) / "missions"
        if not (folder / "two").exists():
            folder.mkdir(parents=True)
            missions(folder, options.size)
        server = ServerProcess(folder, "--workers", "2")
        try:
            under_load(server, options)
            print(f"load of the machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
        finally:
            server.stop()
        server = ServerProcess(folder, "--workers", "0")
        try:
            windows(server, options.size)
            upload(server, folder, options.upload_mb)
        finally:
            server.kill()
        long_queue(folder, options.jobs)
        print(f"load of the machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    return int(not all(RESULTS))


if __name__ == "__main__":
    sys.exit(main())
