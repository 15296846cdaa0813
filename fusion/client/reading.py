"""Calls that read workspaces: views as JSON, and tables."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from fusion.client.arrays import ARROW, JSON, arrow_table, columns_of, has_arrow
from fusion.client.place import View, Viewing
from fusion.client.steps import Steps, call

if TYPE_CHECKING:
    import pyarrow as pa


class Reading(Viewing):
    """Calls that read; `workspace` is a name, and `solution` by default the one in use."""

    @call
    def workspaces(self) -> Steps[list[str]]:
        """Return the names of the workspaces that may be read."""
        return (yield from self.place.workspaces())

    @call
    def overview(self, workspace: str, *, solution: str = "") -> Steps[dict[str, Any]]:
        """Return counts, stages and their state, main results, and problems of a workspace."""
        return (yield from self._view(View.OVERVIEW, workspace, solution=solution))

    @call
    def coverage(
        self, workspace: str, *, step_deg: float = 5.0, solution: str = ""
    ) -> Steps[dict[str, Any]]:
        """Return where maplets, mapolas, bigmaps, images and returns lie on the body."""
        return (
            yield from self._view(View.COVERAGE, workspace, step_deg=step_deg, solution=solution)
        )

    @call
    def items(
        self, workspace: str, kind: str, *, solution: str = ""
    ) -> Steps[list[dict[str, Any]]]:
        """Return all scans, images, maplets, mapolas, fused maplets, bigmaps or pairs.

        Parameters
        ----------
        workspace : str
        kind : str
            ``scans``, ``images``, ``maplets``, ``mapolas``, ``fused``, ``bigmaps`` or ``pairs``.
        solution : str
        """
        content = yield from self._view(View.LIST, workspace, kind=kind, solution=solution)
        found: list[dict[str, Any]] = content[kind]
        return found

    @call
    def outlines(self, workspace: str, kind: str, *, solution: str = "") -> Steps[dict[str, Any]]:
        """Return the squares that maplets, mapolas, fused maplets or bigmaps cover on the body."""
        return (yield from self._view(View.OUTLINES, workspace, kind=kind, solution=solution))

    @call
    def result(self, workspace: str, name: str, *, solution: str = "") -> Steps[dict[str, Any]]:
        """Return ``registration``, ``scale`` or ``manifest`` as its file has it."""
        return (yield from self._view(View.RESULT, workspace, name=name, solution=solution))

    @call
    def residuals(self, workspace: str, *, solution: str = "") -> Steps[dict[str, Any]]:
        """Return the matches of the registration with their residuals, rejected ones marked."""
        return (yield from self._view(View.RESIDUALS, workspace, solution=solution))

    @call
    def epsilon(self, workspace: str, *, solution: str = "") -> Steps[dict[str, Any]]:
        """Return ε with its sigma: of all, per day, by local time and by longitude."""
        return (yield from self._view(View.EPSILON, workspace, solution=solution))

    @call
    def photoclinometry(
        self, workspace: str, maplet: str = "", *, solution: str = ""
    ) -> Steps[dict[str, Any]]:
        """Return goodness of fit of a solution from images, or how one maplet was solved.

        Parameters
        ----------
        workspace : str
        maplet : str
            Empty: all, with a row for each maplet and each image.
        solution : str
        """
        if not maplet:
            return (yield from self._view(View.SOLVED, workspace, solution=solution))
        given = {"maplet": maplet, "solution": solution}
        return (yield from self._view(View.SOLVED_MAPLET, workspace, **given))

    @call
    def solutions(self, workspace: str) -> Steps[dict[str, Any]]:
        """Return the solutions, each after its parent, and which one is in use."""
        return (yield from self._view(View.SOLUTIONS, workspace))

    @call
    def solution(self, workspace: str, name: str) -> Steps[dict[str, Any]]:
        """Return what a solution was made from, by what and when, and what it contains."""
        return (yield from self._view(View.SOLUTION, workspace, name=name))

    @call
    def solutions_compared(self, workspace: str, first: str, second: str) -> Steps[dict[str, Any]]:
        """Return how the solution `second` differs from `first`."""
        names = {"first": first, "second": second}
        return (yield from self._view(View.SOLUTIONS_COMPARED, workspace, **names))

    @call
    def outputs(self, workspace: str) -> Steps[list[dict[str, Any]]]:
        """Return `name` and `bytes` of the files that jobs have written for their users."""
        content = yield from self._view(View.OUTPUTS, workspace)
        found: list[dict[str, Any]] = content["outputs"]
        return found

    @call
    def runs(self, workspace: str) -> Steps[list[dict[str, Any]]]:
        """Return the last run of each stage in each solution, the newest first."""
        found: list[dict[str, Any]] = (yield from self._view(View.RUNS, workspace))["runs"]
        return found

    @call
    def run(self, workspace: str, run: str) -> Steps[dict[str, Any]]:
        """Return a run (``SOLUTION:STAGE``): settings, summary, digests, the job to repeat it."""
        return (yield from self._view(View.RUN, workspace, run=run))

    @call
    def runs_compared(
        self, workspace: str, first: str, second: str, *, other: str = ""
    ) -> Steps[dict[str, Any]]:
        """Return what differs between two runs; `other` is the second's workspace if not this."""
        names = {"first": first, "second": second, "other": other or None}
        return (yield from self._view(View.RUNS_COMPARED, workspace, **names))

    @call
    def provenance(
        self, workspace: str, product: str, *, solution: str = ""
    ) -> Steps[dict[str, Any]]:
        """Return what a file, as ``release/manifest.json``, was made from, back to what came in."""
        return (
            yield from self._view(View.PROVENANCE, workspace, product=product, solution=solution)
        )

    @call
    def tables(self, workspace: str, *, solution: str = "") -> Steps[list[str]]:
        """Return the names of the tables of a workspace."""
        content = yield from self._view(View.TABLES, workspace, solution=solution)
        names: list[str] = content["tables"]
        return names

    @call
    def table(
        self, workspace: str, name: str, *, solution: str = ""
    ) -> Steps[pa.Table | dict[str, np.ndarray]]:
        """Return a table: of pyarrow where it is installed, else arrays by column."""
        accept = ARROW if has_arrow() else JSON
        given = {"name": name, "accept": accept, "solution": solution or None}
        content = yield from self.place.content(View.TABLE, workspace, given)
        return arrow_table(content) if accept == ARROW else columns_of(json.loads(content))
