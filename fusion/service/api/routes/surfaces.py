"""Routes of surfaces: what there is, windows, tiles, values at a point, profiles."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from fastapi import Query
from starlette.requests import Request
from starlette.responses import Response

from fusion.service.api.access import READ, Routes
from fusion.service.api.answers import json_answer, matches, page_of
from fusion.service.api.errors import Refusal, RequestRefusedError
from fusion.service.api.service import opened_for, service_of
from fusion.service.views.surfaces import (
    Surface,
    SurfaceKind,
    colours_of,
    open_surface,
    png_of,
    profile,
    surface_names,
    value_at,
)
from spcola.arrays import FloatArray
from spcola.errors import InvalidValueError

routes = Routes("/api/v1/workspaces/{workspace}/surfaces", "surfaces")
_ONE = "/{kind}/{name}"
_FLOATS = "application/octet-stream"
_BOTH = {200: {"content": {_FLOATS: {}, "image/png": {}}}}

Solution = Annotated[str, Query(max_length=100, description="By default the one in use.")]
Layer = Annotated[str, Query(max_length=32, description="Such as height.")]
Form = Annotated[
    Literal["float32", "png"],
    Query(alias="format", description="float32: little-endian rows, NaN where unknown."),
]
Bits = Annotated[Literal[8, 16], Query(description="Of a PNG: 8 in colours, 16 in codes of grey.")]
Bound = Annotated[float | None, Query(description="Value of the first or last colour of a PNG.")]
Index = Annotated[int, Query(ge=0, le=1 << 30)]
Count = Annotated[int, Query(ge=1, le=1 << 16)]
Level = Annotated[int, Query(ge=1, le=1 << 16, description="Grid points along a side of a cell.")]
Metres = Annotated[float, Query(allow_inf_nan=False)]


@routes.add("GET", "", READ)
def surfaces(
    request: Request,
    workspace: str,
    kind: SurfaceKind | None = None,
    after: Annotated[str, Query(max_length=300)] = "",
    limit: Annotated[int, Query(ge=1, le=10_000)] = 1000,
    solution: Solution = "",
) -> Response:
    """List the surfaces of a workspace by kind and name."""
    kinds = SurfaceKind if kind is None else (kind,)
    with opened_for(request, workspace, solution) as opened:
        every = [(one.value, name) for one in kinds for name in surface_names(opened, one)]
    shown, more = page_of(request, ["/".join(one) for one in every], after, limit)
    found = [dict(zip(("kind", "name"), one.split("/", 1), strict=True)) for one in shown]
    return json_answer(request, {"surfaces": found}, more)


@routes.add("GET", _ONE, READ)
def surface(
    request: Request, workspace: str, kind: SurfaceKind, name: str, solution: Solution = ""
) -> Response:
    """Return grid, layers, overview levels and ranges of values of a surface."""
    return json_answer(request, _opened(request, workspace, kind, name, solution).describe())


@routes.add("GET", f"{_ONE}/window", READ, responses=_BOTH)
def window(
    request: Request,
    workspace: str,
    kind: SurfaceKind,
    name: str,
    rows: Count,
    columns: Count,
    layer: Layer = "height",
    level: Level = 1,
    row: Index = 0,
    column: Index = 0,
    form: Form = "float32",
    bits: Bits = 8,
    low: Bound = None,
    high: Bound = None,
    solution: Solution = "",
) -> Response:
    """Return a window of a layer at an overview level."""
    if rows * columns > service_of(request).limits.window_pixels:
        raise RequestRefusedError(Refusal.INVALID, "is too large", "window", "ask for parts of it")
    found = _opened(request, workspace, kind, name, solution)
    tag = f'"{found.etag}"'
    if matches(request.headers.get("if-none-match", ""), tag):
        return Response(status_code=304, headers={"ETag": tag})
    span = {"rows": (row, row + rows), "columns": (column, column + columns)}
    values = found.window(layer, level=level, **span)
    return _picture(found, layer, values, form, (bits, low, high))


@routes.add("GET", f"{_ONE}/tiles/{{level}}/{{row}}/{{column}}", READ, responses=_BOTH)
def tile(
    request: Request,
    workspace: str,
    kind: SurfaceKind,
    name: str,
    level: int,
    row: int,
    column: int,
    layer: Layer = "height",
    form: Form = "png",
    bits: Bits = 8,
    low: Bound = None,
    high: Bound = None,
    solution: Solution = "",
) -> Response:
    """Return a tile of 256 × 256 of a layer at an overview level."""
    found = _opened(request, workspace, kind, name, solution)
    tag = f'"{found.etag}"'
    if matches(request.headers.get("if-none-match", ""), tag):
        return Response(status_code=304, headers={"ETag": tag})
    values = found.tile(layer, level, row, column)
    return _picture(found, layer, values, form, (bits, low, high))


@routes.add("GET", f"{_ONE}/value", READ)
def value(
    request: Request,
    workspace: str,
    kind: SurfaceKind,
    name: str,
    x: Metres,
    y: Metres,
    solution: Solution = "",
) -> Response:
    """Return all layers at a point, metres from the centre: x along Uy, y along −Ux."""
    found = _opened(request, workspace, kind, name, solution)
    return json_answer(request, value_at(found, x, y))


@routes.add("GET", f"{_ONE}/profile", READ)
def along(
    request: Request,
    workspace: str,
    kind: SurfaceKind,
    name: str,
    begin: Annotated[str, Query(alias="from", max_length=80, examples=["-10,0"])],
    end: Annotated[str, Query(alias="to", max_length=80, examples=["10,0"])],
    layers: Annotated[str, Query(max_length=200, examples=["height,sigma"])] = "",
    solution: Solution = "",
) -> Response:
    """Return layers along a line between two points x,y in metres, with sigma where there is."""
    found = _opened(request, workspace, kind, name, solution)
    wanted = [part.strip() for part in layers.split(",") if part.strip()]
    return json_answer(
        request, profile(found, _point(begin, "from"), _point(end, "to"), wanted).as_json()
    )


@routes.add("GET", f"{_ONE}/colours", READ)
def colours(
    request: Request,
    workspace: str,
    kind: SurfaceKind,
    name: str,
    layer: Layer = "height",
    solution: Solution = "",
) -> Response:
    """Return the colours of a layer's pictures, for a legend: red, green and blue, 0 to 255."""
    found = _opened(request, workspace, kind, name, solution)
    found.check_layer(layer)
    return json_answer(request, {"layer": layer, "colours": colours_of(layer)})


def _opened(
    request: Request, workspace: str, kind: SurfaceKind, name: str, solution: str
) -> Surface:
    with opened_for(request, workspace, solution) as opened:
        return open_surface(opened, kind, name, cache=service_of(request).cache)


def _picture(
    surface: Surface,
    layer: str,
    values: FloatArray,
    form: str,
    how: tuple[Literal[8, 16], float | None, float | None],
) -> Response:
    """Return a window as PNG, or as numbers."""
    rows, columns = values.shape
    headers = {
        "ETag": f'"{surface.etag}"',
        "Cache-Control": "private, no-cache",
        "X-Rows": str(rows),
        "X-Columns": str(columns),
    }
    if form == "float32":
        body = np.ascontiguousarray(values, dtype="<f4").tobytes()
        return Response(body, media_type=_FLOATS, headers=headers)
    bits, low, high = how
    own = surface.range(layer) or (0.0, 1.0)
    limits = (own[0] if low is None else low, own[1] if high is None else high)
    return Response(
        png_of(values, layer, limits, bits=bits), media_type="image/png", headers=headers
    )


def _point(text: str, where: str) -> tuple[float, float]:
    """Return the numbers of a text ``x,y``."""
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError as error:
        raise InvalidValueError(f"{text!r} is no point x,y", where) from error
    return x, y
