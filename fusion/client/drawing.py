"""Calls that have a picture made, and fetch it."""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fusion.client.fetching import Fetching
from fusion.client.steps import Steps, call
from fusion.client.working import Working
from fusion.service.jobs import JobKind


class Drawing(Working, Fetching):
    """Calls that draw: a job makes the picture, and leaves nothing behind."""

    @call
    def look(
        self,
        workspace: str,
        to: str | Path,
        *,
        file: str = "",
        options: Mapping[str, Any] | None = None,
        progress: bool = True,
    ) -> Steps[dict[str, Any]]:
        """Draw what a workspace or a file in it holds, as ``spcola look``; return what was drawn.

        Parameters
        ----------
        workspace : str
        to : str or Path
            The new file: .png, .pdf or .svg.
        file : str
            In the workspace, such as ``MAPFILES/AB0001.MAP``; by default an overview of all.
        options : mapping, optional
            `unit` and `faces_from` of an OBJ or PLY shape.
        progress : bool
        """
        given = {"file": file, **(options or {})}
        found = yield from self._drawn(workspace, JobKind.LOOK, given, Path(to), shown=progress)
        return {**found, "source": Path(workspace, file)}

    @call
    def solutions_drawn(
        self, workspace: str, first: str, second: str, to: str | Path, *, progress: bool = True
    ) -> Steps[dict[str, Any]]:
        """Draw how the solution `second` differs from `first`; return the differences."""
        names, kind = {"first": first, "second": second}, JobKind.SOLUTION_DIFF
        return (yield from self._drawn(workspace, kind, names, Path(to), shown=progress))

    def _drawn(
        self,
        workspace: str,
        kind: JobKind,
        given: Mapping[str, Any],
        target: Path,
        *,
        shown: bool,
    ) -> Steps[dict[str, Any]]:
        """Have a picture made under a name that no other has, fetch it, and remove it there."""
        name = f"{kind.value}-{secrets.token_hex(8)}{target.suffix}"
        parameters = {**given, "out": name}
        result = yield from self._result(workspace, kind, parameters, shown=shown)
        yield from self._downloaded(workspace, f"outputs/{name}", target, shown=False)
        yield from self.place.remove_output(workspace, name)
        return {**result, "picture": target}
