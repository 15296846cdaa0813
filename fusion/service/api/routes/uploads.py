"""Routes of uploads: begun, sent in parts (as tus does), completed with a checksum, removed.

The service writes bytes and counts them. Workers read the files, within limits.
"""

from __future__ import annotations

import os
import shutil
from http import HTTPStatus
from typing import Annotated, Any, Literal

from fastapi import Header
from pydantic import BaseModel, ConfigDict, Field
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response

from fusion.service.api.access import READ, RUN, Routes, caller_of
from fusion.service.api.answers import json_answer
from fusion.service.api.errors import Refusal, RequestRefusedError
from fusion.service.api.pages import After, Limit, page_of
from fusion.service.api.schemas import Media, work
from fusion.service.api.service import Service, service_of
from fusion.service.api.upload_file import UploadFile, clean_name, write_whole
from fusion.service.store import StoreError, StoreFault, Upload
from fusion.service.store.records import UploadState
from fusion.service.work.imported import imported_uploads

routes = Routes("/api/v1/workspaces/{workspace}/uploads", "uploads")
_TUS = {"Tus-Resumable": "1.0.0", "Cache-Control": "no-store"}
_PARTS = {"application/offset+octet-stream", "application/octet-stream"}
_BLOCK = 1 << 20
_NOTED_EVERY = 1 << 26
# What the disk keeps for the store, the logs, and the end of items that are being made.
_RESERVE_BYTES = 1 << 28
_MOST_BODY = 1 << 40
_PART_BODY = {
    "requestBody": {
        "required": True,
        "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
    }
}


class UploadRequest(BaseModel):
    """A file that is going to be sent."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [
                {"name": "ola_scan_1.h5", "size": 1048576, "sha256": "0" * 64, "kind": "scan"}
            ]
        },
    )

    name: str = Field(min_length=1, max_length=255, description="Cleaned of all odd characters.")
    size: int = Field(ge=0, le=1 << 50, description="Bytes.")
    sha256: str = Field(pattern="^[0-9a-fA-F]{64}$", description="Of the whole file.")
    kind: Literal["scan", "image", "kernel", "spc", "shape", "camera", "table", "other"]


@routes.add("POST", "", RUN, work.UPLOAD, status_code=201)
def begin_upload(request: Request, workspace: str, body: UploadRequest) -> Response:
    """Begin an upload; the answer has its id."""
    service = service_of(request)
    # Files of a new workspace come before it is made.
    service.place(workspace)
    name, user = clean_name(body.name), caller_of(request).name
    new = Upload("", workspace, user, name, body.kind, body.size, body.sha256.lower())
    # One after the other: two at once could exceed a limit together.
    with service.beginning:
        _check_room(service, new)
        upload = service.store.uploads.add(new)
    try:
        _file_of(service, upload).begin()
    except BaseException:
        service.store.uploads.end(upload.id, UploadState.REMOVED)
        raise
    headers = {**_TUS, "Location": f"{request.url.path}/{upload.id}", "Upload-Offset": "0"}
    return _answer(request, upload, headers, HTTPStatus.CREATED)


@routes.add("GET", "", READ, work.UPLOADS)
def uploads(request: Request, workspace: str, after: After = "", limit: Limit = 100) -> Response:
    """List the uploads of a workspace that are open or wait for their import."""
    service = service_of(request)
    service.place(workspace)
    found = service.store.uploads.kept(workspace)
    shown, more = page_of(request, found, after, limit, lambda upload: upload.id)
    return json_answer(request, {"uploads": [_json(upload) for upload in shown]}, more)


@routes.add("DELETE", "", RUN, work.Removed)
def remove_imported(request: Request, workspace: str) -> Response:
    """Remove the uploads that finished jobs have brought into the workspace, and no others.

    Cameras, kernels and tables stay, and what a job names that has not ended.
    """
    service = service_of(request)
    service.place(workspace)
    found = imported_uploads(service.store, workspace)
    for upload in found:
        with service.receiving(upload.id):
            _remove(service, upload)
    return json_answer(request, {"removed": len(found), "bytes": _size(found)})


@routes.add("HEAD", "/{upload}", READ, Media((), work.PROGRESS))
def upload_offset(request: Request, workspace: str, upload: str) -> Response:
    """Say how many bytes have arrived (Upload-Offset): where to go on."""
    found = _open(service_of(request), workspace, upload)
    return Response(headers=_progress(found))


@routes.add("GET", "/{upload}", READ, work.UPLOAD)
def upload_state(request: Request, workspace: str, upload: str) -> Response:
    """Return an upload and its state."""
    return _answer(request, _open(service_of(request), workspace, upload))


@routes.add(
    "PATCH",
    "/{upload}",
    RUN,
    Media((), work.PROGRESS),
    status_code=204,
    max_body_size=_MOST_BODY,
    extra=_PART_BODY,
)
async def send_part(
    request: Request,
    workspace: str,
    upload: str,
    offset: Annotated[int, Header(alias="Upload-Offset", ge=0, le=1 << 50)],
) -> Response:
    """Send the bytes from Upload-Offset on. What arrives before a connection breaks is kept."""
    service = service_of(request)
    kind = request.headers.get("content-type", "").partition(";")[0].strip()
    if kind not in _PARTS:
        raise RequestRefusedError(
            Refusal.UNSUPPORTED_MEDIA, "is no part of an upload", "Content-Type", min(_PARTS)
        )
    with service.receiving(upload):
        # Not before: another request may just have ended.
        found = await run_in_threadpool(_open, service, workspace, upload)
        if offset != found.offset or found.state is not UploadState.OPEN:
            raise RequestRefusedError(
                Refusal.WRONG_OFFSET,
                f"{found.offset} bytes have arrived, not {offset}; it is {found.state.value}",
                "Upload-Offset",
            )
        found = await _received(request, service, found)
    return Response(status_code=204, headers=_progress(found))


@routes.add("POST", "/{upload}/complete", RUN, work.UPLOAD)
def complete_upload(request: Request, workspace: str, upload: str) -> Response:
    """Check the checksum and keep the file for a job that imports it."""
    service = service_of(request)
    with service.receiving(upload):
        found = _open(service, workspace, upload)
        if found.offset != found.size:
            raise RequestRefusedError(
                Refusal.WRONG_OFFSET,
                f"{found.offset} of {found.size} bytes have arrived",
                do="send the others",
            )
        file = _file_of(service, found)
        try:
            file.complete(found.sha256)
        except RequestRefusedError:
            # Nobody knows which bytes are wrong.
            service.store.uploads.end(found.id, UploadState.REMOVED)
            file.remove()
            raise
        return _answer(request, service.store.uploads.end(found.id, UploadState.COMPLETE))


@routes.add("DELETE", "/{upload}", RUN, status_code=204)
def remove_upload(request: Request, workspace: str, upload: str) -> Response:
    """Remove an upload and its bytes."""
    service = service_of(request)
    with service.receiving(upload):
        _remove(service, _open(service, workspace, upload))
    return Response(status_code=204)


def _remove(service: Service, upload: Upload) -> None:
    service.store.uploads.end(upload.id, UploadState.REMOVED)
    _file_of(service, upload).remove()


async def _received(request: Request, service: Service, upload: Upload) -> Upload:
    """Write what arrives, and note it when it is on the disk, also if the connection breaks."""
    part = await run_in_threadpool(_file_of(service, upload).open_at, upload.offset)
    waiting = bytearray()
    noted = at = upload.offset

    def write(*, last: bool) -> Upload | None:
        nonlocal noted, at
        write_whole(part, bytes(waiting))
        at += len(waiting)
        waiting.clear()
        if not last and at - noted < _NOTED_EVERY:
            return None
        os.fsync(part)
        done = service.store.uploads.advance(upload.id, noted, at)
        service.metrics.upload_bytes.inc(at - noted)
        noted = at
        return done

    try:
        try:
            async for block in request.stream():
                if at + len(waiting) + len(block) > upload.size:
                    raise RequestRefusedError(
                        Refusal.TOO_LARGE, f"is longer than {upload.size} bytes", upload.name
                    )
                waiting += block
                if len(waiting) >= _BLOCK:
                    await run_in_threadpool(write, last=False)
        except ClientDisconnect:
            await run_in_threadpool(write, last=True)
            raise
        done = await run_in_threadpool(write, last=True)
    finally:
        os.close(part)
    assert done is not None
    return done


def _check_room(service: Service, new: Upload) -> None:
    """Refuse a file that is too large for the limits, the quotas, or the disk."""
    limits = service.limits
    if new.size > limits.upload_bytes:
        raise RequestRefusedError(
            Refusal.TOO_LARGE, f"is more than {limits.upload_bytes} bytes", "size"
        )
    kept = service.store.uploads.kept()
    here = [upload for upload in kept if upload.workspace == new.workspace]
    mine = [upload for upload in kept if upload.user == new.user]
    if len(here) >= limits.uploads or _size(here) + new.size > limits.quota_bytes:
        raise _over_quota(here, "in the workspace", new.workspace)
    if _size(mine) + new.size > limits.user_quota_bytes:
        raise _over_quota(mine, "of this user", new.user)
    # Space that open uploads will take is not there any more.
    promised = sum(upload.size - upload.offset for upload in kept)
    if shutil.disk_usage(service.root).free < promised + new.size + _RESERVE_BYTES:
        raise RequestRefusedError(
            Refusal.DISK_FULL, "there is no space for it on the disk", do="free some"
        )


def _size(uploads: list[Upload]) -> int:
    return sum(upload.size for upload in uploads)


def _over_quota(uploads: list[Upload], whose: str, where: str) -> RequestRefusedError:
    what = f"{len(uploads)} uploads of {_size(uploads)} bytes wait {whose} already"
    return RequestRefusedError(Refusal.OVER_QUOTA, what, where, "import or remove them")


def _open(service: Service, workspace: str, identity: str) -> Upload:
    """Return an upload of a workspace that is not removed."""
    upload = service.store.uploads.get(identity)
    if upload.workspace != workspace or upload.state is UploadState.REMOVED:
        raise StoreError(StoreFault.UNKNOWN_UPLOAD, "there is no such upload", identity[:60])
    return upload


def _file_of(service: Service, upload: Upload) -> UploadFile:
    return UploadFile(service.uploads / upload.id, upload.name)


def _progress(upload: Upload) -> dict[str, str]:
    return {**_TUS, "Upload-Offset": str(upload.offset), "Upload-Length": str(upload.size)}


def _answer(
    request: Request,
    upload: Upload,
    headers: dict[str, str] | None = None,
    status: HTTPStatus = HTTPStatus.OK,
) -> Response:
    answer = json_answer(request, _json(upload), headers)
    if answer.status_code == HTTPStatus.OK:
        answer.status_code = int(status)
    return answer


def _json(upload: Upload) -> dict[str, Any]:
    names = ("id", "name", "kind", "size", "sha256", "offset", "state", "user", "created")
    return {name: getattr(upload, name) for name in names}
