"""Calls that send files: an upload goes on where it was interrupted."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from fusion.client.place import Place
from fusion.client.progress import bytes_bar
from fusion.client.steps import Compute, LostConnectionError, Pause, Steps, call
from fusion.service.api.errors import Refusal, RequestRefusedError
from fusion.service.api.upload_file import clean_name
from fusion.service.commands.images import companions_of
from fusion.service.jobs import Job, JobKind, JobRequest
from fusion.service.work import sent_files
from spcola.errors import WorkspaceError

_PART = 1 << 24
_PATIENCE_S = 120.0
_AGAIN_S = 0.5
# What another request, or the same one whose connection broke, may still be doing.
_PASSING = {Refusal.WRONG_OFFSET, Refusal.CONFLICT}


# Of an import: the kind of its uploads, and options that are files.
_KINDS = {JobKind.IMPORT: "scan", JobKind.IMAGES: "image"}
_FILES: Mapping[JobKind, frozenset[str]] = {
    JobKind.IMPORT: frozenset(),
    JobKind.IMAGES: frozenset({"poses", "camera", "times", "pck", "dark", "flat"}),
}


class Sending:
    """Calls that send files: `kind` of an upload is scan, image, kernel, spc or shape."""

    place: Place

    @call
    def upload(
        self,
        workspace: str,
        path: str | Path,
        kind: str = "scan",
        *,
        name: str = "",
        progress: bool = True,
    ) -> Steps[str]:
        """Upload a file in parts and return the id of the upload, for a job that imports it.

        An upload of the same file that was interrupted goes on, also one of an earlier program; a
        complete one is not sent again. The checksum is compared at the end.

        Parameters
        ----------
        workspace : str
        path : str or Path
        kind : str
        name : str
            In the workspace; by default that of the file.
        progress : bool

        Raises
        ------
        RequestRefusedError
            If it is too large, or arrived with another checksum.
        """
        return (yield from self._uploaded(workspace, Path(path), kind, name, progress=progress))

    @call
    def import_scans(
        self,
        workspace: str,
        files: Sequence[str | Path],
        *,
        options: Mapping[str, Any] | None = None,
        progress: bool = True,
    ) -> Steps[Job]:
        """Upload lidar files, and submit the job that reads them.

        Parameters
        ----------
        workspace : str
        files : sequence of str or Path
        options : mapping, optional
            `name` (of one scan), `format`, `columns`, `unit`, `gps_time`, as ``spcola import``.
        progress : bool
        """
        send = partial(self._uploaded, workspace, progress=progress)
        return (yield from self._imported(workspace, JobKind.IMPORT, files, send, options))

    @call
    def import_images(
        self,
        workspace: str,
        files: Sequence[str | Path],
        *,
        options: Mapping[str, Any] | None = None,
        progress: bool = True,
    ) -> Steps[Job]:
        """Upload images, and submit the job that brings them in: as :meth:`import_scans`.

        Of the `options`, those of a job ``images``, files are uploaded too: `poses`, `camera`,
        `times`, `pck`, `dark` and `flat`. So is what an image needs and lies next to it: pixels of
        a detached label, the label, and with `states` ``isd`` the ISD file.
        """
        send, given = partial(self._uploaded, workspace, progress=progress), dict(options or {})
        images = [Path(one) for one in (*files, given.get("dark"), given.get("flat")) if one]
        more = yield Compute(partial(companions_of, images, isd=given.get("states") == "isd"))
        given["companions"] = list(given.get("companions", ()))
        for file in more:
            given["companions"].append((yield from send(Path(file), "image")))
        return (yield from self._imported(workspace, JobKind.IMAGES, files, send, given))

    @call
    def make_workspace(
        self,
        workspace: str,
        *,
        body: str = "body",
        shape: str | Path | None = None,
        spc: str | Path | Sequence[str | Path] = (),
        shape_unit: str = "km",
        faces_from: int = 1,
        progress: bool = True,
    ) -> Steps[Job]:
        """Upload a shape or SPC files, and submit the job that makes a workspace of them.

        Parameters
        ----------
        workspace : str
            Its name.
        body : str
        shape : str or Path, optional
            A shape model (ICQ, OBJ or PLY), with `shape_unit` and `faces_from`.
        spc : str, Path or sequence of them
            An SPC working folder, whose shape is taken if `shape` is not given; or SPC files. Each
            is put where its name belongs.
        shape_unit, faces_from : str, int
        progress : bool
        """
        given: dict[str, Any] = {"body": body}
        if isinstance(spc, str | Path):
            spc, own = sent_files(Path(spc))
            shape = own if shape is None else shape
        send, given["uploads"] = partial(self._uploaded, workspace, progress=progress), []
        for file in spc:
            given["uploads"].append((yield from send(Path(file), "spc")))
        if shape is not None:
            given |= {"shape_unit": shape_unit, "faces_from": faces_from}
            given["shape"] = yield from send(Path(shape), "shape")
        return (yield from self._submitted(workspace, JobKind.INIT, given))

    @call
    def uploads(self, workspace: str) -> Steps[list[dict[str, Any]]]:
        """Return the uploads that are open or wait for their import."""
        return (yield from self.place.uploads(workspace))

    @call
    def remove_imported_uploads(self, workspace: str) -> Steps[dict[str, int]]:
        """Remove the uploads that finished jobs have brought into the workspace, and no others.

        Cameras, kernels and tables stay, and what a job names that has not ended.

        Returns
        -------
        dict
            `removed`, how many, and their `bytes`.
        """
        return (yield from self.place.remove_imported(workspace))

    def _uploaded(
        self, workspace: str, path: Path, kind: str, name: str = "", *, progress: bool
    ) -> Steps[str]:
        if not path.is_file():
            raise WorkspaceError("there is no such file", path)
        size, digest = path.stat().st_size, (yield Compute(partial(digest_of, path)))
        asked = {"name": name or path.name, "size": size, "sha256": digest, "kind": kind}
        same = {**asked, "name": clean_name(asked["name"])}
        known = [
            one
            for one in (yield from self.place.uploads(workspace))
            if all(one[key] == value for key, value in same.items())
        ]
        # One that is complete before one that is not.
        known.sort(key=lambda one: -one["offset"])
        upload = known[0] if known else (yield from self.place.begin_upload(workspace, asked))
        with bytes_bar(path.name, size, shown=progress) as show:
            while upload["state"] == "open" and upload["offset"] < size:
                upload = yield from self._advanced(workspace, upload, path)
                show(upload["offset"])
        if upload["state"] == "open":
            upload = yield from self.place.complete_upload(workspace, upload["id"])
        return str(upload["id"])

    def _advanced(
        self, workspace: str, upload: Mapping[str, Any], path: Path
    ) -> Steps[dict[str, Any]]:
        """Send the next part of an upload, again and again until some of it has arrived."""
        until = time.monotonic() + _PATIENCE_S
        while True:
            offset = upload["offset"]
            body = yield Compute(partial(_bytes_of, path, offset))
            try:
                yield from self.place.send_part(workspace, upload["id"], offset, body)
                return {**upload, "offset": offset + len(body)}
            except (LostConnectionError, RequestRefusedError) as error:
                passing = isinstance(error, LostConnectionError) or error.code in _PASSING
                if not passing or time.monotonic() > until:
                    raise
            yield Pause(_AGAIN_S)
            upload = yield from self.place.upload(workspace, upload["id"])
            if upload["offset"] > offset:
                return dict(upload)

    def _imported(
        self,
        workspace: str,
        kind: JobKind,
        files: Sequence[str | Path],
        send: Callable[[Path, str], Steps[str]],
        options: Mapping[str, Any] | None,
    ) -> Steps[Job]:
        """Upload files with those that options name, and submit the job that reads them."""
        sent, given = [], dict(options or {})
        for file in files:
            sent.append((yield from send(Path(file), _KINDS[kind])))
        for key in _FILES[kind] & given.keys():
            if given[key] is not None:
                named = "kernel" if key == "pck" else _KINDS[kind]
                given[key] = yield from send(Path(given[key]), named)
        return (yield from self._submitted(workspace, kind, {"uploads": sent, **given}))

    def _submitted(
        self, workspace: str, kind: JobKind, parameters: Mapping[str, Any]
    ) -> Steps[Job]:
        key = hashlib.sha256(os.urandom(32)).hexdigest()[:32]
        return (yield from self.place.submit(JobRequest(kind, workspace, "", parameters, key=key)))


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file; empty if there is none."""
    if not path.is_file():
        return ""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _bytes_of(path: Path, offset: int) -> bytes:
    with path.open("rb") as file:
        file.seek(offset)
        return file.read(_PART)
