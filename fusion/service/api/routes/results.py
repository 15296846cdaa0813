"""Routes of results: JSON, tables, the body's shape, solutions, runs and provenance."""

from __future__ import annotations

from dataclasses import replace
from operator import itemgetter
from typing import Annotated, Any

import numpy as np
from fastapi import Query
from starlette.requests import Request
from starlette.responses import Response

from fusion.inspection import describe_solution
from fusion.service.api.access import READ, Routes, caller_of
from fusion.service.api.answers import accepted, by_tag, json_answer, tagged
from fusion.service.api.errors import Refusal, RequestRefusedError
from fusion.service.api.pages import After, Limit, page_of
from fusion.service.api.schemas import results as answers
from fusion.service.api.schemas import solved, surfaces
from fusion.service.api.service import opened_for, service_of
from fusion.service.store import Scope
from fusion.service.texts import without_paths_in
from fusion.service.views.body import shape_bytes, shape_etag, shape_layers, vertex_layer
from fusion.service.views.history import (
    provenance,
    run_list,
    run_record,
    run_request,
    runs_compared,
    solution_tree,
    solutions_compared,
)
from fusion.service.views.photoclinometry import (
    solved_etag,
    solved_index,
    solved_maplet,
    solved_picture,
)
from fusion.service.views.results import epsilon_table, residuals, result_json
from fusion.service.views.tables import TableFormat, read_table, table_names

routes = Routes("/api/v1/workspaces/{workspace}", "results")
_BYTES = "application/octet-stream"

Solution = Annotated[str, Query(max_length=100, description="By default the one in use.")]
Facets = Annotated[int | None, Query(ge=100, le=1 << 24, description="At most about so many.")]


@routes.add("GET", "/results/{name}", READ, answers.Result)
def result(request: Request, workspace: str, name: str, solution: Solution = "") -> Response:
    """Return a result: registration, scale or manifest, as its file has it."""
    with opened_for(request, workspace, solution) as opened:
        return json_answer(request, result_json(opened, name))


@routes.add("GET", "/products", READ, answers.Manifest)
def products(request: Request, workspace: str, solution: Solution = "") -> Response:
    """Return the manifest of the release: its products, with their files."""
    with opened_for(request, workspace, solution) as opened:
        return json_answer(request, result_json(opened, "manifest"))


@routes.add("GET", "/tables", READ, answers.TABLES)
def tables(
    request: Request,
    workspace: str,
    after: After = "",
    limit: Limit = 100,
    solution: Solution = "",
) -> Response:
    """List the tables of a workspace."""
    with opened_for(request, workspace, solution) as opened:
        shown, more = page_of(request, table_names(opened), after, limit)
    return json_answer(request, {"tables": shown}, more)


@routes.add("GET", "/tables/{name}", READ, answers.TABLE)
def table(request: Request, workspace: str, name: str, solution: Solution = "") -> Response:
    """Return a table in the form that Accept names: JSON, CSV, an Arrow stream or Parquet."""
    form = TableFormat(accepted(request, [form.value for form in TableFormat]))
    with opened_for(request, workspace, solution) as opened:
        found = read_table(opened, name)
    shown = replace(found, columns=without_paths_in(found.columns, service_of(request).root))
    return tagged(request, shown.as_bytes(form), form.value)


@routes.add("GET", "/registration/residuals", READ, answers.Residuals)
def registration_residuals(request: Request, workspace: str, solution: Solution = "") -> Response:
    """Return the matches of the registration with their residuals, rejected ones marked."""
    with opened_for(request, workspace, solution) as opened:
        return json_answer(request, residuals(opened))


@routes.add("GET", "/scale/epsilon", READ, answers.Epsilon)
def scale_epsilon(request: Request, workspace: str, solution: Solution = "") -> Response:
    """Return epsilon with its sigma per day, by local time and by longitude."""
    with opened_for(request, workspace, solution) as opened:
        return json_answer(request, epsilon_table(opened))


@routes.add("GET", "/photoclinometry", READ, solved.SolvedIndex)
def photoclinometry(request: Request, workspace: str, solution: Solution = "") -> Response:
    """Return the goodness of fit of each maplet and image of a solution from images."""
    with opened_for(request, workspace, solution) as opened:
        return json_answer(request, solved_index(opened))


@routes.add("GET", "/photoclinometry/{maplet}", READ, solved.SolvedMaplet)
def photoclinometry_maplet(
    request: Request, workspace: str, maplet: str, solution: Solution = ""
) -> Response:
    """Return how a maplet was solved from images, by round, and how each image fits."""
    with opened_for(request, workspace, solution) as opened:
        return json_answer(request, solved_maplet(opened, maplet))


@routes.add("GET", "/photoclinometry/{maplet}/{image}", READ, solved.SOLVED_PICTURE)
def photoclinometry_picture(
    request: Request, workspace: str, maplet: str, image: str, solution: Solution = ""
) -> Response:
    """Return an image on the grid of a maplet, its rendering, and the residual: one PNG."""
    cache = service_of(request).cache
    with opened_for(request, workspace, solution) as opened:
        return by_tag(
            request,
            solved_etag(opened, maplet, image),
            "image/png",
            lambda: solved_picture(opened, maplet, image, cache=cache),
        )


@routes.add("GET", "/solutions", READ, answers.SOLUTIONS)
def solutions(request: Request, workspace: str, after: After = "", limit: Limit = 100) -> Response:
    """Return the solutions, each with its parent, and which one is in use."""
    with opened_for(request, workspace) as opened:
        tree = solution_tree(opened)
    shown, more = page_of(request, tree["solutions"], after, limit, itemgetter("name"))
    return json_answer(request, {**tree, "solutions": shown}, more)


@routes.add("GET", "/solutions/{name}", READ, answers.ONE_SOLUTION)
def one_solution(request: Request, workspace: str, name: str) -> Response:
    """Return what a solution was made from, by what and when, and what it contains."""
    with opened_for(request, workspace, name) as opened:
        return json_answer(request, describe_solution(opened))


@routes.add("GET", "/solutions/{first}/diff/{second}", READ, answers.SolutionDifference)
def difference(request: Request, workspace: str, first: str, second: str) -> Response:
    """Return how the second solution differs from the first."""
    with opened_for(request, workspace) as opened:
        return json_answer(request, solutions_compared(opened, first, second))


@routes.add("GET", "/runs", READ, answers.RUNS)
def runs(request: Request, workspace: str, after: After = "", limit: Limit = 100) -> Response:
    """List the last run of each stage in each solution, the newest first."""
    with opened_for(request, workspace) as opened:
        shown, more = page_of(request, run_list(opened), after, limit, itemgetter("id"))
    return json_answer(request, {"runs": shown}, more)


@routes.add("GET", "/runs/{run}", READ, answers.Run)
def one_run(request: Request, workspace: str, run: str) -> Response:
    """Return a run with its settings, summary, digests, and the job that reproduces it."""
    with opened_for(request, workspace) as opened:
        content = {**run_record(opened, run), "request": run_request(opened, run)}
    return json_answer(request, content)


@routes.add("GET", "/runs/{first}/diff/{second}", READ, answers.RunDifference)
def run_difference(
    request: Request,
    workspace: str,
    first: str,
    second: str,
    other: Annotated[str, Query(max_length=64, description="Workspace of the second run.")] = "",
) -> Response:
    """Return what differs between two runs; the second may be that of another workspace."""
    if other and not caller_of(request).may(Scope.READ, other):
        raise RequestRefusedError(Refusal.FORBIDDEN, "may not be read", "other")
    with opened_for(request, workspace) as opened:
        one = run_record(opened, first)
    with opened_for(request, other or workspace) as opened:
        return json_answer(request, runs_compared(one, run_record(opened, second)))


@routes.add("GET", "/provenance", READ, answers.Provenance)
def made_from(
    request: Request,
    workspace: str,
    product: Annotated[str, Query(max_length=1000, examples=["release/manifest.json"])],
    solution: Solution = "",
) -> Response:
    """Return what a file was made from, back to the imported files."""
    with opened_for(request, workspace, solution) as opened:
        return json_answer(request, provenance(opened, product))


@routes.add("GET", "/shape", READ, surfaces.FLOATS)
def shape(
    request: Request, workspace: str, facets: Facets = None, solution: Solution = ""
) -> Response:
    """Return the shape: length of a JSON header (uint32), header, vertices float32, faces uint32.

    All little-endian; vertices in metres from the header's `center_m`.
    """
    cache = service_of(request).cache
    with opened_for(request, workspace, solution) as opened:
        return by_tag(
            request,
            shape_etag(opened, facets),
            _BYTES,
            lambda: shape_bytes(opened, facets, cache=cache),
        )


@routes.add("GET", "/shape/layers", READ, surfaces.SHAPE_LAYERS)
def layers_of_shape(request: Request, workspace: str, solution: Solution = "") -> Response:
    """List the layers on the shape, and of which kind of surface each one is taken."""
    with opened_for(request, workspace, solution) as opened:
        return json_answer(request, {"layers": shape_layers(opened)})


@routes.add("GET", "/shape/layers/{layer}", READ, surfaces.FLOATS)
def shape_layer(
    request: Request, workspace: str, layer: str, facets: Facets = None, solution: Solution = ""
) -> Response:
    """Return a layer on the vertices of the shape: float32, little-endian, NaN where unknown."""
    cache = service_of(request).cache
    with opened_for(request, workspace, solution) as opened:

        def read() -> bytes:
            values: Any = vertex_layer(opened, layer, facets, cache=cache)
            return np.ascontiguousarray(values, dtype="<f4").tobytes()

        return by_tag(request, shape_etag(opened, facets, layer), _BYTES, read)
