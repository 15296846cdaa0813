"""A local folder as a place of workspaces: what the service reads, without a server."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from fusion.client.local_jobs import LocalJobs
from fusion.client.place import FilePart, View
from fusion.client.steps import Compute, Steps
from fusion.inspection import describe_solution
from fusion.runtime import json_value
from fusion.service.api.errors import Refusal, RequestRefusedError
from fusion.service.api.folder import ServedFolder
from fusion.service.state import outputs_folder, visible_file
from fusion.service.views import ListKind, coverage, list_page, overview
from fusion.service.views.body import mesh_bytes, shape_layers, shape_mesh, vertex_layer
from fusion.service.views.history import (
    provenance,
    run_list,
    run_record,
    run_request,
    runs_compared,
    solution_tree,
    solutions_compared,
)
from fusion.service.views.outlines import outlines, same_place
from fusion.service.views.photoclinometry import solved_index, solved_maplet
from fusion.service.views.results import epsilon_table, residuals, result_json
from fusion.service.views.surfaces import (
    LayerCache,
    Surface,
    SurfaceKind,
    open_surface,
    profile,
    surface_names,
    value_at,
)
from fusion.service.views.tables import TableFormat, read_table, table_names
from fusion.service.work.places import output_files, remove_output
from fusion.workspace import Workspace

_PAGE = 1000


class Local(LocalJobs):
    """The workspaces of a folder: a workspace, or one whose sub-folders are workspaces.

    Parameters
    ----------
    root : Path
    """

    def __init__(self, root: Path) -> None:
        self.folder = ServedFolder(root)
        self.cache = LayerCache()
        super().__init__(self.folder)

    @property
    def name(self) -> str:
        """Path of the folder."""
        return str(self.folder.root)

    def workspaces(self) -> Steps[list[str]]:
        """Return the names of the workspaces."""
        return (yield Compute(self.folder.names))

    def view(self, view: View, workspace: str, given: Mapping[str, Any]) -> Steps[dict[str, Any]]:
        """Return JSON: a view, in the types that a server's answer has."""

        def read() -> Any:
            with self._reading(workspace, given) as (opened, others):
                found = json_value(_VIEWS[view](self, opened, **others))
            return json.loads(json.dumps(found))

        return (yield Compute(read))

    def content(self, view: View, workspace: str, given: Mapping[str, Any]) -> Steps[bytes]:
        """Return the bytes of a table (in the form `accept`), a window, a shape or its layer."""

        def read() -> bytes:
            with self._reading(workspace, given) as (opened, others):
                return _CONTENTS[view](self, opened, **others)

        return (yield Compute(read))

    def file(self, workspace: str, path: str, begin: int, count: int, tag: str) -> Steps[FilePart]:
        """Return up to `count` bytes of a file from `begin` on; all of it anew if it changed."""
        return (yield Compute(lambda: self._part(workspace, path, begin, count, tag)))

    def remove_output(self, workspace: str, name: str) -> Steps[None]:
        """Remove what a job wrote for its user."""

        def remove() -> None:
            self.folder.folder(workspace)
            if not remove_output(self.folder.root, workspace, name):
                raise RequestRefusedError(Refusal.NOT_FOUND, "there is no such output", name)

        yield Compute(remove)

    @contextmanager
    def _reading(
        self, workspace: str, given: Mapping[str, Any]
    ) -> Iterator[tuple[Workspace, dict[str, Any]]]:
        """Open the solution that is asked for; yield it with what else is."""
        others = {name: value for name, value in given.items() if value is not None}
        with self.folder.opened(workspace, others.pop("solution", "")) as opened:
            yield opened, others

    def surface(self, opened: Workspace, kind: str, name: str) -> Surface:
        """Open a surface whose overview levels are kept for the next call."""
        return open_surface(opened, _kind(kind), name, cache=self.cache)

    def _part(self, workspace: str, path: str, begin: int, count: int, tag: str) -> FilePart:
        area, _, path = path.partition("/")
        root = self.folder.folder(workspace)
        if area == "outputs":
            root = outputs_folder(self.folder.root, workspace)
        found = visible_file(root, path)
        if found is None or not found.is_file():
            raise RequestRefusedError(Refusal.NOT_FOUND, "there is no such file", path)
        with found.open("rb") as file:
            status = found.stat()
            now = f"{status.st_mtime_ns:x}-{status.st_size:x}"
            begin = begin if tag in ("", now) and begin < status.st_size else 0
            file.seek(begin)
            return FilePart(file.read(count), begin, status.st_size, now)


def _listed(_: Local, opened: Workspace, kind: str) -> dict[str, Any]:
    """Return a list of all pages."""
    if kind not in set(ListKind):
        raise RequestRefusedError(Refusal.NOT_FOUND, "Not Found")
    items: list[Any] = []
    page = list_page(opened, ListKind(kind), limit=_PAGE)
    items += page.items
    while page.next:
        page = list_page(opened, ListKind(kind), after=page.next, limit=_PAGE)
        items += page.items
    return {kind: items, "total": page.total}


def _outputs(place: Local, opened: Workspace) -> dict[str, Any]:
    sizes = output_files(place.folder.root, opened.root.name)
    return {"outputs": [{"name": name, "bytes": sizes[name]} for name in sorted(sizes)]}


def _surfaces(_: Local, opened: Workspace, kind: str = "") -> dict[str, Any]:
    kinds = (_kind(kind),) if kind else SurfaceKind
    pairs = [f"{one}/{name}" for one in kinds for name in surface_names(opened, one)]
    split = (pair.split("/", 1) for pair in sorted(pairs))
    return {"surfaces": [dict(zip(("kind", "name"), one, strict=True)) for one in split]}


def _profile(place: Local, opened: Workspace, kind: str, name: str, **line: str) -> dict[str, Any]:
    begin, end = (_point(line[key]) for key in ("from", "to"))
    layers = [part for part in line.get("layers", "").split(",") if part]
    return profile(place.surface(opened, kind, name), begin, end, layers).as_json()


def _surface(place: Local, opened: Workspace, kind: str, name: str) -> dict[str, Any]:
    found = place.surface(opened, kind, name)
    others = same_place(opened, _kind(kind), name)
    alike = [dict(zip(("kind", "name"), one, strict=True)) for one in others]
    return {**found.describe(), "same_place": alike}


def _runs_compared(
    place: Local, opened: Workspace, first: str, second: str, other: str = ""
) -> dict[str, Any]:
    one = run_record(opened, first)
    with place.folder.opened(other) if other else nullcontext(opened) as their:
        return runs_compared(one, run_record(their, second))


def _window(place: Local, opened: Workspace, kind: str, name: str, **asked: Any) -> bytes:
    surface = place.surface(opened, kind, name)
    rows = (asked["row"], asked["row"] + asked["rows"])
    columns = (asked["column"], asked["column"] + asked["columns"])
    return _floats(surface.window(asked["layer"], level=asked["level"], rows=rows, columns=columns))


def _point(text: str) -> tuple[float, float]:
    x, y = (float(part) for part in text.split(","))
    return x, y


def _floats(values: Any) -> bytes:
    return np.ascontiguousarray(values, dtype="<f4").tobytes()


def _kind(kind: str) -> SurfaceKind:
    if kind not in set(SurfaceKind):
        wanted = ", ".join(f"'{one}'" for one in SurfaceKind)
        raise RequestRefusedError(Refusal.INVALID, f"Input should be {wanted}", "path.kind")
    return SurfaceKind(kind)


_VIEWS: Mapping[View, Callable[..., Any]] = {
    View.OVERVIEW: lambda _, opened: overview(opened),
    View.COVERAGE: lambda _, opened, **given: coverage(opened, **given),
    View.LIST: _listed,
    View.OUTLINES: lambda _, opened, kind: outlines(opened, _kind(kind)),
    View.RESULT: lambda _, opened, name: result_json(opened, name),
    View.TABLES: lambda _, opened: {"tables": table_names(opened)},
    View.RESIDUALS: lambda _, opened: residuals(opened),
    View.EPSILON: lambda _, opened: epsilon_table(opened),
    View.SOLVED: lambda _, opened: solved_index(opened),
    View.SOLVED_MAPLET: lambda _, opened, maplet: solved_maplet(opened, maplet),
    View.SOLUTIONS: lambda _, opened: solution_tree(opened),
    View.SOLUTION: lambda _, opened, name: describe_solution(Workspace.open(opened.root, name)),
    View.SOLUTIONS_COMPARED: lambda _, opened, first, second: solutions_compared(
        opened, first, second
    ),
    View.OUTPUTS: _outputs,
    View.RUNS: lambda _, opened: {"runs": run_list(opened)},
    View.RUN: lambda _, opened, run: {
        **run_record(opened, run),
        "request": run_request(opened, run),
    },
    View.RUNS_COMPARED: _runs_compared,
    View.PROVENANCE: lambda _, opened, product: provenance(opened, product),
    View.SURFACES: _surfaces,
    View.SURFACE: _surface,
    View.VALUE: lambda place, opened, kind, name, x, y: value_at(
        place.surface(opened, kind, name), x, y
    ),
    View.PROFILE: _profile,
    View.SHAPE_LAYERS: lambda _, opened: {"layers": shape_layers(opened)},
}
_CONTENTS: Mapping[View, Callable[..., bytes]] = {
    View.TABLE: lambda _, opened, name, accept: read_table(opened, name).as_bytes(
        TableFormat(accept)
    ),
    View.WINDOW: _window,
    View.SHAPE: lambda place, opened, facets=None: mesh_bytes(
        shape_mesh(opened, facets, cache=place.cache)
    ),
    View.SHAPE_LAYER: lambda place, opened, layer, facets=None: _floats(
        vertex_layer(opened, layer, facets, cache=place.cache)
    ),
}
