"""A folder of the service with its server process, and the jobs and files that it is given."""

from __future__ import annotations

import hashlib
import shutil
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
from kills import digests_of
from server_process import ServerProcess

from fusion.service.state import STATE_FOLDER

PATIENCE_S = 300.0


@dataclass(frozen=True)
class Step:
    """A job that is killed.

    Attributes
    ----------
    title, workspace, kind : str
    parameters : dict
    files : dict
        Files, or lists of files, that are uploaded and named by these parameters.
    """

    title: str
    workspace: str
    kind: str
    parameters: dict[str, Any] = field(default_factory=dict)
    files: dict[str, Path | list[Path]] = field(default_factory=dict)


class Served:
    """A folder of the service with its server process."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.server: ServerProcess | None = None

    def start(self) -> httpx.Client:
        self.kill()
        with self.folder.with_name("errors").open("ab") as errors:
            self.server = ServerProcess(self.folder, "--workers", "1", errors=errors)
        return self.server.client()

    def kill(self) -> None:
        if self.server is not None:
            self.server.kill()
            self.server = None

    def stop(self) -> None:
        """End it in order: the worker of a killed one closes the store some time later."""
        if self.server is not None:
            self.server.stop()
            self.server = None

    def places(self, workspace: str) -> dict[str, Path]:
        """Return where the files of a workspace, and the outputs of its jobs, lie."""
        outputs = self.folder / STATE_FOLDER / "outputs" / workspace
        return {"workspace": self.folder / workspace, "outputs": outputs}

    def files(self, workspace: str) -> dict[str, str]:
        """Return the digests of the workspace's files and of the outputs of its jobs."""
        places = self.places(workspace).items()
        return {
            f"{where}/{name}": one
            for where, place in places
            for name, one in digests_of(place).items()
        }

    def aside(self) -> set[str]:
        """Return the files of the service that belong to a job under way."""
        state = self.folder / STATE_FOLDER
        found = [*state.glob("gathered/*"), *state.glob("outputs/*/.*"), *state.rglob("*.part")]
        return {path.relative_to(self.folder).as_posix() for path in found}

    def keep(self, workspace: str, kept: Path) -> None:
        """Keep the workspace and its outputs as they are."""
        for name, place in self.places(workspace).items():
            _copied(place, kept / name)

    def restore(self, workspace: str, kept: Path) -> None:
        """Bring back what was kept."""
        for name, place in self.places(workspace).items():
            _copied(kept / name, place)


def _copied(source: Path, target: Path) -> None:
    shutil.rmtree(target, ignore_errors=True)
    if source.exists():
        shutil.copytree(source, target, symlinks=True)


def submit(client: httpx.Client, step: Step, given: dict[str, Any]) -> str:
    body = {"kind": step.kind, "parameters": {**step.parameters, **given}}
    return str(_answer(client.post(f"/api/v1/workspaces/{step.workspace}/jobs", json=body))["id"])


def _answer(answer: httpx.Response) -> dict[str, Any]:
    if answer.is_error:
        raise SystemExit(f"{answer.request.method} {answer.request.url}: {answer.text}")
    return dict(answer.json())


def job_of(client: httpx.Client, job: str) -> dict[str, Any]:
    return _answer(client.get(f"/api/v1/jobs/{job}"))


def awaited(client: httpx.Client, job: str, states: Iterable[str], tries: int = 0) -> dict:
    """Wait until a job is in one of some states, and was begun so often; return it."""
    until = time.monotonic() + PATIENCE_S
    while True:
        found = job_of(client, job)
        ended = found["state"] not in ("waiting", "running")
        if ended or (found["state"] in states and found["tries"] >= tries):
            return found
        if time.monotonic() > until:
            raise SystemExit(f"job {job} hangs: {found}")
        time.sleep(0.003)


def upload(client: httpx.Client, workspace: str, path: Path) -> str:
    """Upload a file; return its id."""
    content = path.read_bytes()
    digest = hashlib.sha256(content).hexdigest()
    new = {"name": path.name, "size": len(content), "sha256": digest, "kind": "other"}
    base = f"/api/v1/workspaces/{workspace}/uploads"
    made = str(_answer(client.post(base, json=new))["id"])
    head = {"Upload-Offset": "0", "Content-Type": "application/octet-stream"}
    client.patch(f"{base}/{made}", content=content, headers=head).raise_for_status()
    _answer(client.post(f"{base}/{made}/complete"))
    return made
