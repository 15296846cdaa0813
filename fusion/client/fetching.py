"""Calls that fetch files: a download goes on where it was interrupted."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from fusion.client.place import View, Viewing
from fusion.client.progress import bytes_bar
from fusion.client.sending import digest_of
from fusion.client.steps import Compute, Steps, call
from spcola.errors import FormatError, InvalidValueError, WorkspaceError

_PART = 1 << 24


class Fetching(Viewing):
    """Calls that fetch files: those of a workspace, outputs of jobs, products."""

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
        listed = (yield from self._view(View.OUTPUTS, workspace))["outputs"]
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
    def remove_output(self, workspace: str, name: str) -> Steps[None]:
        """Remove what a job wrote for its user: a file, or a folder with all that is in it."""
        yield from self.place.remove_output(workspace, name)

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
            if (yield Compute(partial(digest_of, file))) != wanted:
                place = f"files/{home}release/{name}"
                yield from self._downloaded(workspace, place, file, shown=progress)
                if (yield Compute(partial(digest_of, file))) != wanted:
                    yield Compute(file.unlink)
                    raise FormatError("is not what the manifest states", file, "release again")
            found.append(file)
        return found

    def _manifest(self, workspace: str, solution: str) -> Steps[dict[str, Any]]:
        return (yield from self._view(View.RESULT, workspace, name="manifest", solution=solution))

    def _home(self, workspace: str, solution: str) -> Steps[str]:
        """Return where the results of a solution lie in the workspace."""
        if not solution:
            solution = (yield from self._view(View.SOLUTIONS, workspace))["in_use"]
        facts = yield from self._view(View.SOLUTION, workspace, name=solution)
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
