"""Mutated files uploaded to the service and read by its workers: refused in one line, or read.

    python -m scripts.bench.service.fuzz_uploads [--inputs 100] [--seed 0] [--kind laz ...]
        [--http 1]

The good files and their mutations are those of `scripts/bench/fuzz.py`; the job that reads each is
in `upload_jobs.py`. Most inputs go straight to what a worker does with a job, in a process of its
own with the worker's limits and child processes, without queue and server; `--http` of each kind go
through a real server. `refused`: one line. `poisonous`: it ended every process that read it (too
much memory or time, or a crash), and was named. `wrong`: any other code, as an unexpected error.
`deaths`: the worker itself died; `hangs`: no answer in time. The last three are to be 0.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import resource
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import httpx
import psutil

BENCH = Path(__file__).parents[1]
sys.path[:0] = [str(BENCH), str(BENCH.parents[1] / "tests" / "helpers")]
from fuzz import input_of  # noqa: E402
from fuzz_samples import KINDS  # noqa: E402
from server_process import ServerProcess  # noqa: E402

from fusion.runtime.children import ProcessExecutor  # noqa: E402
from fusion.runtime.processes import ProcessLimits, limited_memory  # noqa: E402
from fusion.service.jobs import Job, JobError, JobKind, JobRequest, JobState  # noqa: E402
from fusion.service.state import STATE_FOLDER, uploads_folder  # noqa: E402
from fusion.service.store import Upload  # noqa: E402
from fusion.service.work import Places  # noqa: E402
from fusion.service.work.kinds import Assignment, perform_job  # noqa: E402
from fusion.service.work.outcomes import job_error  # noqa: E402
from fusion.service.work.report import JobReport  # noqa: E402
from fusion.workspace import new_workspace  # noqa: E402
from scripts.bench.service.upload_jobs import (  # noqa: E402
    GOOD,
    NAMES,
    READINGS,
    SAMPLES_OF,
    make_good,
)

LIMITS = ProcessLimits(memory_mb=2048, seconds=20.0)
SILENT_S = 90.0
PATIENCE_S = 180.0
COLUMNS = ("refused", "accepted", "poisonous", "wrong", "deaths", "hangs")
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


def mutated_of(kind: str, seed: int, number: int) -> bytes:
    """Return an input of a kind; number -1 is the good file."""
    if number < 0:
        return GOOD[kind]
    return input_of(KINDS[SAMPLES_OF.get(kind, kind)], GOOD[kind], kind, seed, number)


def outcome_of(error: JobError | None) -> str:
    """Return what a job's error means."""
    if error is None:
        return "accepted"
    if error.code in REFUSED and "\n" not in error.text:
        return "refused"
    return "poisonous" if error.code == "poisonous-item" else "wrong"


class Worker:
    """Does jobs as a worker does, without a queue, each in a new workspace."""

    def __init__(self, folder: Path, executor: ProcessExecutor) -> None:
        self.folder, self.executor = folder, executor
        self.sent: dict[str, Upload] = {}
        self.places = Places(folder, self.sent.__getitem__)
        self.template = folder / STATE_FOLDER / "template"
        if not self.template.exists():
            new_workspace(self.template, body="Ball")

    def attempt(self, kind: str, content: bytes) -> JobError | None:
        """Read a file as its job does; return the job's error."""
        reading, root = READINGS[kind], self.folder / "ws"
        for place in (root, uploads_folder(self.folder)):
            shutil.rmtree(place, ignore_errors=True)
        self.sent.clear()
        if not reading.fresh:
            shutil.copytree(self.template, root)
        given = reading.parameters(self._send, NAMES[kind], self._send(NAMES[kind], content))
        given = {key: one for key, one in given.items() if one is not None}
        request = JobRequest(JobKind(reading.job), "ws", "ann", given)
        job = Job("job", request, JobState.RUNNING, 1, 0.0, 0.0, float("nan"))
        report = JobReport(job, lambda _text, _level: None)
        try:
            with limited_memory(LIMITS.memory_mb):
                perform_job(Assignment(job, self.places, self.executor, report))
        except Exception as error:
            return job_error(error)
        return None

    def _send(self, name: str, content: bytes) -> str:
        identity = f"u{len(self.sent)}"
        path = uploads_folder(self.folder) / identity / "file" / name
        path.parent.mkdir(parents=True)
        path.write_bytes(content)
        self.sent[identity] = Upload(identity, "ws", "ann", name, "other", len(content), "")
        return identity


@dataclass(frozen=True)
class Inputs:
    """All inputs, in the order in which they are read: of each kind the good file first."""

    kinds: list[str]
    count: int
    seed: int

    def __len__(self) -> int:
        return len(self.kinds) * (self.count + 1)

    def __getitem__(self, index: int) -> tuple[str, int]:
        """Return the kind and the number of an input."""
        place, number = divmod(index, self.count + 1)
        return self.kinds[place], number - 1


def serve_inputs(inputs: Inputs, first: int, folder: Path) -> None:
    """Run in a process of its own: read inputs, and print a line for each."""
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    make_good(folder.parent / "good")
    with ProcessExecutor(1, limits=LIMITS, tries=1) as executor:
        worker = Worker(folder, executor)
        for index in range(first, len(inputs)):
            kind, number = inputs[index]
            error = worker.attempt(kind, mutated_of(kind, inputs.seed, number))
            text = "" if error is None else f"{error.code}: {error.text}"
            print(outcome_of(error), " ".join(text.split())[:300], file=answers)
    largest = max(
        resource.getrusage(who).ru_maxrss
        for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    print("memory", largest // 1024, file=answers)


class Direct:
    """Inputs that are read in a process of a worker, and in another one if that dies."""

    def __init__(self, work: Path, inputs: Inputs) -> None:
        self.work, self.inputs = work, inputs
        self.memory_mb, self.next, self.total = 0, 0, Counter[str]()
        self._counts: Counter[str] = Counter()

    def run(self) -> None:
        """Read all inputs and print the table."""
        print_head()
        while self.next < len(self.inputs):
            self._process()
        print_row("all", self.total)

    def _process(self) -> None:
        """Read inputs in a process until it ends or dies."""
        folder, inputs = self.work / "direct", self.inputs
        shutil.rmtree(folder, ignore_errors=True)
        numbers = (self.next, inputs.count, inputs.seed)
        arguments = [*map(str, numbers), str(folder), *inputs.kinds]
        process = subprocess.Popen(
            [sys.executable, "-m", "scripts.bench.service.fuzz_uploads", "--worker", *arguments],
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
        assert process.stdout is not None
        silent, rest = False, b""
        while True:
            if not select.select([process.stdout], [], [], SILENT_S)[0]:
                silent = True
                os.killpg(process.pid, signal.SIGKILL)
            block = os.read(process.stdout.fileno(), 1 << 16)
            if not block:
                break
            *lines, rest = (rest + block).split(b"\n")
            for line in lines:
                outcome, _, text = line.decode(errors="replace").partition(" ")
                self._note(outcome, text)
        process.wait()
        if self.next < len(inputs):
            self._note("hangs" if silent else "deaths", f"exit code {process.returncode}")

    def _note(self, outcome: str, text: str) -> None:
        """Count the outcome of the next input."""
        if outcome == "memory":
            self.memory_mb = max(self.memory_mb, int(text))
            return
        kind, number = self.inputs[self.next]
        self.next += 1
        if number >= 0 or outcome not in COLUMNS[:2]:
            self._counts[outcome] += 1
        if (number < 0 and outcome != "accepted") or outcome in COLUMNS[2:]:
            name = "good file" if number < 0 else str(number)
            print(f"    {outcome}: {kind} {name}: {text}", flush=True)
        if number == self.inputs.count - 1:
            print_row(kind, self._counts)
            self.total += self._counts
            self._counts = Counter()


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


@dataclass
class OverHttp:
    """Inputs that are uploaded to a real server, and read by its workers."""

    client: httpx.Client
    root: Path
    seed: int
    count: int = 0

    def tried(self, kind: str, count: int) -> Counter[str]:
        """Upload inputs of a kind, submit their jobs; return how many had which outcome."""
        jobs = [self._submit(kind, mutated_of(kind, self.seed, n)) for n in range(count)]
        counts: Counter[str] = Counter()
        until = time.monotonic() + PATIENCE_S + 10.0 * len(jobs)
        for job in jobs:
            while True:
                found = self.client.get(f"/api/v1/jobs/{job}").raise_for_status().json()
                if found["state"] not in ("waiting", "running"):
                    error = found["error"] and JobError(**found["error"])
                    outcome = outcome_of(error)
                    counts[outcome] += 1
                    if outcome in COLUMNS[2:]:
                        print(f"    {outcome} over HTTP: {kind}: {error}", flush=True)
                    break
                if time.monotonic() > until:
                    counts["hangs"] += 1
                    break
                time.sleep(0.1)
        return counts

    def _submit(self, kind: str, content: bytes) -> str:
        self.count += 1
        reading, workspace = READINGS[kind], f"ws{self.count}"
        if not reading.fresh:
            new_workspace(self.root / workspace, body="Ball")

        def send(name: str, content: bytes) -> str:
            return self._upload(workspace, name, content)

        given = reading.parameters(send, NAMES[kind], send(NAMES[kind], content))
        given = {key: one for key, one in given.items() if one is not None}
        body = {"kind": reading.job, "parameters": given}
        answer = self.client.post(f"/api/v1/workspaces/{workspace}/jobs", json=body)
        return str(answer.raise_for_status().json()["id"])

    def _upload(self, workspace: str, name: str, content: bytes) -> str:
        digest = hashlib.sha256(content).hexdigest()
        new = {"name": name, "size": len(content), "sha256": digest, "kind": "other"}
        base = f"/api/v1/workspaces/{workspace}/uploads"
        made = self.client.post(base, json=new).raise_for_status().json()["id"]
        head = {"Upload-Offset": "0", "Content-Type": "application/octet-stream"}
        self.client.patch(f"{base}/{made}", content=content, headers=head).raise_for_status()
        self.client.post(f"{base}/{made}/complete").raise_for_status()
        return str(made)


def print_head() -> None:
    print(f"{'kind':18}{'inputs':>8}" + "".join(f"{one:>11}" for one in COLUMNS), flush=True)


def print_row(kind: str, counts: Counter[str]) -> None:
    shown = "".join(f"{counts[one]:11d}" for one in COLUMNS)
    print(f"{kind:18}{sum(counts.values()):8d}{shown}", flush=True)


def over_http(work: Path, kinds: list[str], options: argparse.Namespace) -> int:
    """Send inputs through a real server; return 1 if one did what none may."""
    root = work / "missions"
    root.mkdir()
    server = ServerProcess(root, "--workers", "2")
    largest = Largest(server.process.pid)
    largest.start()
    try:
        with server.client() as client:
            sender, total = OverHttp(client, root, options.seed), Counter[str]()
            print("through a server:")
            for kind in kinds:
                total += sender.tried(kind, options.http)
            print_head()
            print_row("all", total)
            alive = client.get("/health").status_code == 200
            codes = client.get("/metrics").text
    finally:
        server.kill()
    failed = [line for line in codes.splitlines() if 'status="5' in line]
    limit = ProcessLimits().memory_mb
    print(f"largest process of the workers {largest.workers:.0f} MB, limit {limit} MB")
    print(f"server {largest.server:.0f} MB; answers at the end: {alive}; with a 5xx: {len(failed)}")
    bad = any(total[one] for one in COLUMNS[3:]) or largest.workers > limit
    return int(bad or bool(failed) or not alive)


def main() -> int:
    """Read all inputs and print the tables; return 1 if one did what none may."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--inputs", type=int, default=100, help="of each kind, without a server")
    parser.add_argument("--http", type=int, default=1, help="of each kind, through a server")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", nargs="*", choices=list(READINGS), help="all if not given")
    parser.add_argument("--worker", nargs="*", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        first, count, seed, folder, *kinds = options.worker
        serve_inputs(Inputs(kinds, int(count), int(seed)), int(first), Path(folder))
        return 0
    kinds = options.kind or list(READINGS)
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        work = Path(folder).resolve()
        make_good(work / "good")
        direct = Direct(work, Inputs(kinds, options.inputs, options.seed))
        direct.run()
        print(f"largest process {direct.memory_mb} MB, limit {LIMITS.memory_mb} MB")
        bad = any(direct.total[one] for one in COLUMNS[3:])
        bad |= direct.memory_mb > LIMITS.memory_mb
        return int(bad) | (over_http(work, kinds, options) if options.http else 0)


if __name__ == "__main__":
    sys.exit(main())
