"""Calls that read workspaces: views as JSON, surfaces as arrays, tables."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fusion.client.arrays import ARROW, JSON, arrow_table, columns_of, has_arrow, mesh_of
from fusion.client.layers import SurfaceLayers
from fusion.client.place import Place, View
from fusion.client.steps import Steps, call
from spcola.arrays import FloatArray, IntArray
from spcola.errors import InvalidValueError

if TYPE_CHECKING:
    import pyarrow as pa
    import xarray as xr

# Cells of one request: a quarter of what a server gives at once.
_CELLS = 1 << 20


class Reading:
    """Calls that read; `workspace` is a name, and `solution` by default the one in use."""

    place: Place

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

    @call
    def surfaces(
        self, workspace: str, kind: str = "", *, solution: str = ""
    ) -> Steps[list[dict[str, str]]]:
        """Return `kind` and `name` of all surfaces, or of those of one kind.

        Parameters
        ----------
        workspace : str
        kind : str
            ``maplet``, ``mapola``, ``fused``, ``bigmap``, ``pair`` or ``dtm``.
        solution : str
        """
        content = yield from self._view(
            View.SURFACES, workspace, kind=kind or None, solution=solution
        )
        found: list[dict[str, str]] = content["surfaces"]
        return found

    @call
    def surface(
        self, workspace: str, kind: str, name: str, *, solution: str = ""
    ) -> Steps[dict[str, Any]]:
        """Return grid, layers, overview levels and ranges of values of a surface."""
        return (
            yield from self._view(View.SURFACE, workspace, kind=kind, name=name, solution=solution)
        )

    @call
    def window(
        self,
        workspace: str,
        kind: str,
        name: str,
        layer: str = "height",
        *,
        level: int = 1,
        rows: tuple[int, int] | None = None,
        columns: tuple[int, int] | None = None,
        solution: str = "",
    ) -> Steps[FloatArray]:
        """Return a window of a layer at an overview level; by default all of it.

        Parameters
        ----------
        workspace, kind, name : str
        layer : str
            ``height``, ``sigma``, ``albedo``, ``hillshade``, ``count``, ``source``,
            ``difference`` or ``slope``, as far as the surface has it.
        level : int
            Grid points on a cell's side: 1, 2, 4, …
        rows, columns : (int, int), optional
            First one, and one beyond the last.
        solution : str

        Returns
        -------
        (R, C) float32 ndarray
            Rows run down along Ux, columns to the right along Uy; NaN where unknown.
        """
        about = yield from self._about(workspace, kind, name, solution)
        spans = _spans(about, level, rows, columns)
        one = (workspace, kind, name, solution)
        return (yield from self._window(one, layer, level, spans))

    @call
    def layers(
        self,
        workspace: str,
        kind: str,
        name: str,
        layers: Sequence[str] = (),
        *,
        level: int = 1,
        rows: tuple[int, int] | None = None,
        columns: tuple[int, int] | None = None,
        solution: str = "",
    ) -> Steps[SurfaceLayers]:
        """Return layers of a surface with their coordinates, units and frame, all by default."""
        return (
            yield from self._layers((workspace, kind, name, solution), layers, level, rows, columns)
        )

    @call
    def dataset(
        self,
        workspace: str,
        kind: str,
        name: str,
        layers: Sequence[str] = (),
        *,
        level: int = 1,
        rows: tuple[int, int] | None = None,
        columns: tuple[int, int] | None = None,
        solution: str = "",
    ) -> Steps[xr.Dataset]:
        """Return layers of a surface as an xarray.Dataset: see :class:`SurfaceLayers`.

        Raises
        ------
        SettingsError
            If xarray is not installed.
        """
        found = yield from self._layers(
            (workspace, kind, name, solution), layers, level, rows, columns
        )
        return found.to_xarray()

    @call
    def value(
        self, workspace: str, kind: str, name: str, x: float, y: float, *, solution: str = ""
    ) -> Steps[dict[str, Any]]:
        """Return all layers of a surface at a point, metres from its centre."""
        given = {"kind": kind, "name": name, "x": x, "y": y, "solution": solution}
        return (yield from self._view(View.VALUE, workspace, **given))

    @call
    def profile(
        self,
        workspace: str,
        kind: str,
        name: str,
        begin: tuple[float, float],
        end: tuple[float, float],
        *,
        layers: Sequence[str] = (),
        solution: str = "",
    ) -> Steps[dict[str, Any]]:
        """Return layers along a line as arrays (N,); NaN where unknown.

        Parameters
        ----------
        workspace, kind, name : str
        begin, end : (float, float)
            x along Uy and y along −Ux, metres from the centre.
        layers : sequence of str
            By default all but hillshade and slope.
        solution : str

        Returns
        -------
        dict
            `distance_m`, `x_m`, `y_m`, `longitude_deg`, `latitude_deg`, and `layers` by name.
        """
        ends = {key: f"{x!r},{y!r}" for key, (x, y) in (("from", begin), ("to", end))}
        given = {"kind": kind, "name": name, **ends, "solution": solution}
        found = yield from self._view(
            View.PROFILE, workspace, **given, layers=",".join(layers) or None
        )
        values = {key: _array(value) for key, value in found.items() if key != "layers"}
        return {**values, "layers": {key: _array(one) for key, one in found["layers"].items()}}

    @call
    def shape(
        self, workspace: str, *, facets: int | None = None, solution: str = ""
    ) -> Steps[tuple[FloatArray, IntArray]]:
        """Return the body's shape, with at most about as many `facets` if given.

        Returns
        -------
        vertices : (V, 3) ndarray
            Metres, body-fixed, rounded to float32 from the middle of the body.
        faces : (F, 3) ndarray
            Counter-clockwise seen from outside.
        """
        given = {"facets": facets, "solution": solution or None}
        return mesh_of((yield from self.place.content(View.SHAPE, workspace, given)))

    @call
    def shape_layers(self, workspace: str, *, solution: str = "") -> Steps[list[dict[str, Any]]]:
        """Return the layers on the shape, and of which kind of surface each one is taken."""
        content = yield from self._view(View.SHAPE_LAYERS, workspace, solution=solution)
        found: list[dict[str, Any]] = content["layers"]
        return found

    @call
    def shape_layer(
        self, workspace: str, layer: str, *, facets: int | None = None, solution: str = ""
    ) -> Steps[FloatArray]:
        """Return a layer (V,) on the vertices of the shape, float32; NaN where unknown."""
        given = {"layer": layer, "facets": facets, "solution": solution or None}
        content = yield from self.place.content(View.SHAPE_LAYER, workspace, given)
        return np.frombuffer(content, "<f4")

    def _view(self, view: View, workspace: str, **given: Any) -> Steps[dict[str, Any]]:
        given["solution"] = given.get("solution") or None
        return (yield from self.place.view(view, workspace, given))

    def _about(self, workspace: str, kind: str, name: str, solution: str) -> Steps[dict[str, Any]]:
        return (
            yield from self._view(View.SURFACE, workspace, kind=kind, name=name, solution=solution)
        )

    def _layers(
        self,
        one: tuple[str, str, str, str],
        names: Sequence[str],
        level: int,
        rows: tuple[int, int] | None,
        columns: tuple[int, int] | None,
    ) -> Steps[SurfaceLayers]:
        about = yield from self._about(*one)
        spans = _spans(about, level, rows, columns)
        values = {}
        for name in names or [layer["name"] for layer in about["layers"]]:
            values[name] = yield from self._window(one, name, level, spans)
        return SurfaceLayers.of(about, level, spans, values)

    def _window(
        self,
        one: tuple[str, str, str, str],
        layer: str,
        level: int,
        spans: tuple[tuple[int, int], tuple[int, int]],
    ) -> Steps[FloatArray]:
        """Return a window in as many parts as the server's limit takes."""
        (top, below), (left, beyond) = spans
        step = max(1, _CELLS // max(1, beyond - left))
        workspace, kind, name, solution = one
        parts = []
        for row in range(top, max(below, top + 1), step):
            count = min(step, below - row)
            given: Mapping[str, Any] = {
                "kind": kind, "name": name, "layer": layer, "level": level,
                "row": row, "column": left, "rows": count, "columns": beyond - left,
                "format": "float32", "solution": solution or None,
            }  # fmt: skip
            content = yield from self.place.content(View.WINDOW, workspace, given)
            parts.append(np.frombuffer(content, "<f4").reshape(count, beyond - left))
        return np.concatenate(parts)


def _spans(
    about: Mapping[str, Any],
    level: int,
    rows: tuple[int, int] | None,
    columns: tuple[int, int] | None,
) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return rows and columns of a window, all of the level where none are given."""
    cells = {each["level"]: each["cells"] for each in about["levels"]}
    if level not in cells:
        there = ", ".join(map(str, cells))
        raise InvalidValueError(f"has no level {level}", about["name"], f"there are: {there}")
    whole = (0, cells[level])
    found = (rows or whole, columns or whole)
    for what, (low, high) in zip(("rows", "columns"), found, strict=True):
        if not 0 <= low < high <= cells[level]:
            raise InvalidValueError(
                f"{what} {low} to {high} are not inside 0 to {cells[level]} of level {level}",
                about["name"],
            )
    return found


def _array(values: Sequence[float | None]) -> FloatArray:
    """Return numbers of JSON, in which NaN is null."""
    return np.array(values, dtype=float)
