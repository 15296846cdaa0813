"""Jobs and uploads of a local folder: the store and the worker process of the service."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from fusion.client.steps import Compute, Emit, Emitting, Pause, Steps
from fusion.runtime import json_value, usable_cores
from fusion.service.api.folder import ServedFolder
from fusion.service.api.parameters import check_parameters
from fusion.service.api.upload_file import UploadFile, clean_name, write_whole
from fusion.service.jobs import Event, Job, JobRequest, JobState
from fusion.service.state import STATE_FOLDER, STORE_NAME
from fusion.service.store import Store, StoreError, StoreFault, Upload
from fusion.service.store.records import UploadState
from fusion.service.work.imported import imported_uploads

if TYPE_CHECKING:
    from fusion.service.work import Supervisor

_LOOK_S = 0.2
_PAGE = 500


class LocalJobs:
    """Jobs of the workspaces of a folder, with the store of the service in it.

    One worker process does them as long as the session is open; another session, or
    ``spcola serve``, goes on with those that are left.
    """

    def __init__(self, folder: ServedFolder) -> None:
        self.folder = folder
        self._lock = threading.Lock()
        self._store: Store | None = None
        self._crew: Supervisor | None = None

    def close(self) -> None:
        """Let the worker finish its current items, and close the store."""
        with self._lock:
            if self._crew is not None:
                self._crew.stop()
            if self._store is not None:
                self._store.close()
            self._crew = self._store = None

    def uploads(self, workspace: str) -> Steps[list[dict[str, Any]]]:
        """Return the uploads that are open or wait for their import."""

        def read() -> list[dict[str, Any]]:
            self.folder.place(workspace)
            return [_upload_json(one) for one in self._opened().uploads.kept(workspace)]

        return (yield Compute(read))

    def begin_upload(self, workspace: str, asked: Mapping[str, Any]) -> Steps[dict[str, Any]]:
        """Begin an upload."""

        def begin() -> dict[str, Any]:
            self.folder.place(workspace)
            name, size = clean_name(asked["name"]), asked["size"]
            new = Upload("", workspace, _user(), name, asked["kind"], size, asked["sha256"])
            upload = self._opened().uploads.add(new)
            self._file(upload).begin()
            return _upload_json(upload)

        return (yield Compute(begin))

    def upload(self, workspace: str, upload: str) -> Steps[dict[str, Any]]:
        """Return an upload and how many bytes have arrived."""
        return (yield Compute(lambda: _upload_json(self._one(workspace, upload))))

    def send_part(self, workspace: str, upload: str, offset: int, body: bytes) -> Steps[None]:
        """Write bytes of an upload."""

        def write() -> None:
            found = self._one(workspace, upload)
            part = self._file(found).open_at(offset)
            try:
                write_whole(part, body)
                os.fsync(part)
            finally:
                os.close(part)
            self._opened().uploads.advance(upload, offset, offset + len(body))

        yield Compute(write)

    def complete_upload(self, workspace: str, upload: str) -> Steps[dict[str, Any]]:
        """Check the checksum of an upload, and keep it for a job."""

        def complete() -> dict[str, Any]:
            found = self._one(workspace, upload)
            self._file(found).complete(found.sha256)
            return _upload_json(self._opened().uploads.end(upload, UploadState.COMPLETE))

        return (yield Compute(complete))

    def remove_imported(self, workspace: str) -> Steps[dict[str, int]]:
        """Remove the uploads that finished jobs have brought into the workspace."""

        def remove() -> dict[str, int]:
            self.folder.place(workspace)
            store = self._opened()
            found = imported_uploads(store, workspace)
            for upload in found:
                store.uploads.end(upload.id, UploadState.REMOVED)
                self._file(upload).remove()
            return {"removed": len(found), "bytes": sum(one.size for one in found)}

        return (yield Compute(remove))

    def submit(self, request: JobRequest) -> Steps[Job]:
        """Submit a job, and see that a worker does it."""

        def add() -> Job:
            self._check(request)
            mine = JobRequest(**{**_fields(request), "user": _user()})
            return self._working().submit(mine)

        return (yield from self._job(add))

    def job(self, identity: str) -> Steps[Job]:
        """Return a job; one that is left from another session is done by now."""

        def read() -> Job:
            job = self._opened().job(identity)
            if not job.state.ended:
                self._working()
            return job

        return (yield from self._job(read))

    def jobs(self, workspace: str, states: Sequence[JobState], limit: int) -> Steps[list[Job]]:
        """Return jobs, the newest first."""

        def read() -> list[Job]:
            if workspace:
                self.folder.folder(workspace)
            chosen = [workspace] if workspace else None
            return self._opened().jobs(workspaces=chosen, states=states or None, limit=limit)

        found: list[Job] = yield Compute(read)
        return [_as_sent(job) for job in found]

    def cancel(self, identity: str) -> Steps[Job]:
        """Cancel a job."""
        return (yield from self._job(lambda: self._opened().cancel(identity)))

    def log(self, identity: str) -> Steps[list[dict[str, Any]]]:
        """Return the lines of a job's log."""

        def read() -> list[dict[str, Any]]:
            self._opened().job(identity)
            lines, after = [], 0
            while found := self._opened().events(after, job=identity, limit=_PAGE):
                after = found[-1].number
                lines += [
                    {"number": one.number, "time": one.time, **dict(one.content)}
                    for one in found
                    if one.kind == "note"
                ]
            return lines

        return (yield Compute(read))

    def events(self, job: str, workspace: str, after: int | None) -> Emitting[Event]:
        """Emit events as they happen."""
        chosen = [workspace] if workspace else None

        def read() -> Sequence[Event]:
            if job:
                self._opened().job(job)
            return self._opened().events(after or 0, job=job, workspaces=chosen, limit=_PAGE)

        if after is None and not job:
            after = yield Compute(self._last)
        while True:
            for event in (yield Compute(read)):
                after = event.number
                content = json_value(event.as_json())
                yield Emit(Event.from_json(event.number, event.kind, content))
            yield Pause(_LOOK_S)

    def _check(self, request: JobRequest) -> None:
        """Refuse a job that cannot begin."""
        store = self._opened()
        before = [store.job(one).request.workspace for one in request.after]
        check_parameters(
            self.folder,
            store.uploads,
            request.workspace,
            request.kind,
            request.parameters,
            follows=request.workspace in before,
        )

    def _job(self, made: Callable[[], Job]) -> Steps[Job]:
        job: Job = yield Compute(made)
        return _as_sent(job)

    def _last(self) -> int:
        """Return the number of the last event."""
        last = 0
        while found := self._opened().events(last, limit=100_000):
            last = found[-1].number
        return last

    def _opened(self) -> Store:
        """Open the store, once."""
        with self._lock:
            if self._store is None:
                self._store = Store(self.folder.root / STATE_FOLDER / STORE_NAME)
            return self._store

    def _working(self) -> Store:
        """Return the store of which a worker does the jobs."""
        from fusion.service.work import Supervisor, WorkOptions, worker_command  # noqa: PLC0415

        store = self._opened()
        with self._lock:
            if self._crew is None:
                root = self.folder.root
                options = WorkOptions(threads=usable_cores(), poll_s=0.1)
                path = root / STATE_FOLDER / STORE_NAME
                command = worker_command(root, path, options)
                self._crew = Supervisor(command, 1, lost=store.lost, quiet=True)
                self._crew.start()
        return store

    def _one(self, workspace: str, identity: str) -> Upload:
        upload = self._opened().uploads.get(identity)
        if upload.workspace != workspace or upload.state is UploadState.REMOVED:
            raise StoreError(StoreFault.UNKNOWN_UPLOAD, "there is no such upload", identity[:60])
        return upload

    def _file(self, upload: Upload) -> UploadFile:
        return UploadFile(self.folder.uploads / upload.id, upload.name)


def _as_sent(job: Job) -> Job:
    """Return a job as a server's answer has it."""
    return Job.from_json(json_value(job.as_json()))


def _user() -> str:
    return "local"


def _fields(request: JobRequest) -> dict[str, Any]:
    return {name: getattr(request, name) for name in request.__dataclass_fields__}


def _upload_json(upload: Upload) -> dict[str, Any]:
    content: dict[str, Any] = json_value(asdict(upload))
    return content
