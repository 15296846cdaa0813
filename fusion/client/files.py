"""Calls that move files: uploads and downloads, each goes on where it was interrupted."""

from __future__ import annotations

import hashlib
import os
import re
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from fusion.client.place import Place, View
from fusion.client.progress import bytes_bar
from fusion.client.steps import Compute, LostConnectionError, Pause, Steps, call
from fusion.service.api.errors import Refusal, RequestRefusedError
from fusion.service.api.upload_file import clean_name
from fusion.service.jobs import Job, JobKind, JobRequest
from spcola.errors import FormatError, InvalidValueError, WorkspaceError

_PART = 1 << 24
_PATIENCE_S = 120.0
_AGAIN_S = 0.5
# What another request, or the same one whose connection broke, may still be doing.
_PASSING = {Refusal.WRONG_OFFSET, Refusal.CONFLICT}


class Moving:
    """Calls on files: `kind` of an upload is scan, image, kernel, spc or shape."""

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
        sent = yield from self._all_uploaded(workspace, files, "scan", progress=progress)
        return (
            yield from self._submitted(
                workspace, JobKind.IMPORT, {"uploads": sent, **(options or {})}
            )
        )

    @call
    def import_images(
        self,
        workspace: str,
        files: Sequence[str | Path],
        *,
        options: Mapping[str, Any] | None = None,
        progress: bool = True,
    ) -> Steps[Job]:
        """Upload images, and submit the job that brings them in.

        Parameters
        ----------
        workspace : str
        files : sequence of str or Path
        options : mapping, optional
            As of a job ``images``; `poses`, `camera`, `times`, `pck`, `dark` and `flat` are paths
            of files, which are uploaded too.
        progress : bool
        """
        given = dict(options or {})
        sent = yield from self._all_uploaded(workspace, files, "image", progress=progress)
        for key in ("poses", "camera", "times", "pck", "dark", "flat"):
            if given.get(key) is not None:
                kind = "kernel" if key == "pck" else "image"
                given[key] = yield from self._uploaded(
                    workspace, Path(given[key]), kind, progress=progress
                )
        return (yield from self._submitted(workspace, JobKind.IMAGES, {"uploads": sent, **given}))

    @call
    def make_workspace(
        self,
        workspace: str,
        *,
        body: str = "body",
        shape: str | Path | None = None,
        spc: Sequence[str | Path] = (),
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
        spc : sequence of str or Path
            SPC files; each is put where its name belongs.
        shape_unit, faces_from : str, int
        progress : bool
        """
        given: dict[str, Any] = {"body": body}
        given["uploads"] = yield from self._all_uploaded(workspace, spc, "spc", progress=progress)
        if shape is not None:
            given |= {"shape_unit": shape_unit, "faces_from": faces_from}
            given["shape"] = yield from self._uploaded(
                workspace, Path(shape), "shape", progress=progress
            )
        return (yield from self._submitted(workspace, JobKind.INIT, given))

    @call
    def uploads(self, workspace: str) -> Steps[list[dict[str, Any]]]:
        """Return the uploads that are open or wait for their import."""
        return (yield from self.place.uploads(workspace))

    @call
    def products(self, workspace: str, *, solution: str = "") -> Steps[list[dict[str, Any]]]:
        """Return the products of the release: `file`, `kind`, `maplet`, `sha256`, `bytes`, …."""
        return list((yield from self._manifest(workspace, solution))["products"])

    @call
    def download(
        self, workspace: str, path: str, to: str | Path = ".", *, progress: bool = True
    ) -> Steps[Path]:
        """Fetch a file of a workspace; one that was interrupted goes on.

        Parameters
        ----------
        workspace : str
        path : str
            In the workspace, such as ``registration.json``.
        to : str or Path
            A folder, or the new file.
        progress : bool

        Returns
        -------
        Path
            The file, which is whole.
        """
        target = Path(to)
        target = target / Path(path).name if target.is_dir() else target
        return (yield from self._downloaded(workspace, f"files/{path}", target, shown=progress))

    @call
    def download_output(
        self, workspace: str, name: str, to: str | Path, *, progress: bool = True
    ) -> Steps[list[Path]]:
        """Fetch what a job wrote for its user: a file, or a folder with all that is in it.

        Parameters
        ----------
        workspace : str
        name : str
            Its first name in `outputs`.
        to : str or Path
            The new file or folder.
        progress : bool

        Raises
        ------
        InvalidValueError
            If there is no such output.
        """
        listed = (yield from self.place.view(View.OUTPUTS, workspace, {}))["outputs"]
        names = [one["name"] for one in listed]
        inside = [one for one in names if one == name or one.startswith(f"{name}/")]
        if not inside:
            raise InvalidValueError("is no output of a job", name, "list the outputs")
        found = []
        for one in inside:
            target = Path(to) / one.removeprefix(f"{name}/") if one != name else Path(to)
            yield Compute(partial(target.parent.mkdir, parents=True, exist_ok=True))
            path = f"outputs/{one}"
            found.append((yield from self._downloaded(workspace, path, target, shown=progress)))
        return found

    @call
    def download_products(
        self,
        workspace: str,
        folder: str | Path,
        names: Sequence[str] = (),
        *,
        solution: str = "",
        progress: bool = True,
    ) -> Steps[list[Path]]:
        """Fetch products of the release with its manifest, and compare their checksums.

        Those that are in the folder already are not fetched again.

        Parameters
        ----------
        workspace : str
        folder : str or Path
            Made if it is not there.
        names : sequence of str
            Files of products; by default all.
        solution : str
        progress : bool

        Raises
        ------
        InvalidValueError
            If there is no such product.
        FormatError
            If a file is not what the manifest states.
        """
        manifest = yield from self._manifest(workspace, solution)
        entries = {one["file"]: one for one in manifest["products"]}
        unknown = [name for name in names if name not in entries]
        if unknown:
            raise InvalidValueError("is no product of the release", unknown[0], "list the products")
        target, home = Path(folder), (yield from self._home(workspace, solution))
        yield Compute(lambda: target.mkdir(parents=True, exist_ok=True))
        place = f"files/{home}release/manifest.json"
        found = [
            (yield from self._downloaded(workspace, place, target / "manifest.json", shown=False))
        ]
        for name in names or entries:
            file, wanted = target / Path(name).name, entries[name]["sha256"]
            if (yield Compute(partial(_digest, file))) != wanted:
                place = f"files/{home}release/{name}"
                yield from self._downloaded(workspace, place, file, shown=progress)
                if (yield Compute(partial(_digest, file))) != wanted:
                    yield Compute(file.unlink)
                    raise FormatError("is not what the manifest states", file, "release again")
            found.append(file)
        return found

    def _uploaded(
        self, workspace: str, path: Path, kind: str, name: str = "", *, progress: bool
    ) -> Steps[str]:
        if not path.is_file():
            raise WorkspaceError("there is no such file", path)
        size, digest = path.stat().st_size, (yield Compute(partial(_digest, path)))
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

    def _all_uploaded(
        self, workspace: str, files: Sequence[str | Path], kind: str, *, progress: bool
    ) -> Steps[list[str]]:
        found = []
        for file in files:
            one = yield from self._uploaded(workspace, Path(file), kind, progress=progress)
            found.append(one)
        return found

    def _submitted(
        self, workspace: str, kind: JobKind, parameters: Mapping[str, Any]
    ) -> Steps[Job]:
        key = hashlib.sha256(os.urandom(32)).hexdigest()[:32]
        return (yield from self.place.submit(JobRequest(kind, workspace, "", parameters, key=key)))

    def _manifest(self, workspace: str, solution: str) -> Steps[dict[str, Any]]:
        given = {"name": "manifest", "solution": solution or None}
        return (yield from self.place.view(View.RESULT, workspace, given))

    def _home(self, workspace: str, solution: str) -> Steps[str]:
        """Return where the results of a solution lie in the workspace."""
        if not solution:
            solution = (yield from self.place.view(View.SOLUTIONS, workspace, {}))["in_use"]
        facts = yield from self.place.view(View.SOLUTION, workspace, {"name": solution})
        return "" if facts["folder"] == "." else f"{facts['folder']}/"

    def _downloaded(self, workspace: str, path: str, target: Path, *, shown: bool) -> Steps[Path]:
        """Fetch a file in parts; those of the same file that are there already stay."""
        if not target.parent.is_dir():
            raise WorkspaceError("is not a folder", target.parent, "create it")
        part, tag = _part_there(target)
        begin = part.stat().st_size if part else 0
        got = yield from self.place.file(workspace, path, begin, _PART, tag)
        with bytes_bar(target.name, got.size, shown=shown) as show:
            while True:
                if part is None or got.tag != tag:
                    # The file is new, or another than before.
                    if part is not None:
                        part.unlink()
                    part, tag = _part_path(target, got.tag), got.tag
                yield Compute(partial(_write_at, part, got.begin, got.content))
                reached = got.begin + len(got.content)
                show(reached)
                if reached >= got.size:
                    break
                got = yield from self.place.file(workspace, path, reached, _PART, tag)
        yield Compute(partial(part.replace, target))
        return target


def _digest(path: Path) -> str:
    """Return the SHA-256 of a file; empty if there is none."""
    if not path.is_file():
        return ""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _bytes_of(path: Path, offset: int) -> bytes:
    with path.open("rb") as file:
        file.seek(offset)
        return file.read(_PART)


def _part_path(target: Path, tag: str) -> Path:
    """Return where the beginning of a file is kept; its name has the tag of the whole."""
    return target.with_name(f".{target.name}.{tag.encode().hex()}.part")


def _part_there(target: Path) -> tuple[Path | None, str]:
    """Return the beginning of a file that was kept, and the tag of the whole."""
    form = re.compile(rf"\.{re.escape(target.name)}\.([0-9a-f]+)\.part")
    for path in sorted(target.parent.iterdir()):
        if match := form.fullmatch(path.name):
            return path, bytes.fromhex(match[1]).decode()
    return None, ""


def _write_at(part: Path, begin: int, content: bytes) -> None:
    """Write bytes to a file that has those before; what comes after is cut."""
    with part.open("r+b" if part.exists() else "wb") as file:
        file.truncate(begin)
        file.seek(begin)
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
