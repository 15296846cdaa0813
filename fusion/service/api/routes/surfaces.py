"""Routes of surfaces: what there is, windows, tiles, values at a point, profiles."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Literal

import numpy as np
from fastapi import Depends, Query
from pydantic import BaseModel, Field
from starlette.requests import Request
from starlette.responses import Response

from fusion.service.api.access import READ, Routes
from fusion.service.api.answers import json_answer, matches
from fusion.service.api.errors import Refusal, RequestRefusedError
from fusion.service.api.pages import After, page_of
from fusion.service.api.schemas import surfaces as answers
from fusion.service.api.service import opened_for, service_of
from fusion.service.views.outlines import same_place
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

Solution = Annotated[str, Query(max_length=100, description="By default the one in use.")]
Metres = Annotated[float, Query(allow_inf_nan=False)]


class Picture(BaseModel):
    """Which layer is wanted, and in which form."""

    layer: str = Field(default="height", max_length=32)
    form: Literal["float32", "png"] = Field(
        default="png", alias="format", description="float32: little-endian, NaN where unknown."
    )
    bits: Literal["8", "16"] = Field(
        default="8", description="Of a PNG: 8 in colours, 16 in codes of grey, 0 where unknown."
    )
    low: float | None = Field(default=None, description="Value of a PNG's first colour.")
    high: float | None = Field(default=None, description="Value of a PNG's last colour.")


class Window(Picture):
    """A window of a layer at an overview level."""

    form: Literal["float32", "png"] = Field(default="float32", alias="format")
    level: int = Field(default=1, ge=1, le=1 << 16, description="Grid points on a cell's side.")
    row: int = Field(default=0, ge=0, le=1 << 30)
    column: int = Field(default=0, ge=0, le=1 << 30)
    rows: int = Field(ge=1, le=1 << 16)
    columns: int = Field(ge=1, le=1 << 16)


def _opened(
    request: Request, workspace: str, kind: SurfaceKind, name: str, solution: Solution = ""
) -> Surface:
    with opened_for(request, workspace, solution) as opened:
        return open_surface(opened, kind, name, cache=service_of(request).cache)


Found = Annotated[Surface, Depends(_opened)]


@routes.add("GET", "", READ, answers.SURFACES)
def surfaces(
    request: Request,
    workspace: str,
    kind: SurfaceKind | None = None,
    after: After = "",
    limit: Annotated[int, Query(ge=1, le=10_000)] = 1000,
    solution: Solution = "",
) -> Response:
    """List the surfaces of a workspace by kind and name."""
    kinds = SurfaceKind if kind is None else (kind,)
    with opened_for(request, workspace, solution) as opened:
        every = [(one.value, name) for one in kinds for name in surface_names(opened, one)]
    shown, more = page_of(request, sorted(every), after, limit, "/".join)
    found = [dict(zip(("kind", "name"), one, strict=True)) for one in shown]
    return json_answer(request, {"surfaces": found}, more)


@routes.add("GET", _ONE, READ, answers.Described)
def surface(
    request: Request,
    found: Found,
    workspace: str,
    kind: SurfaceKind,
    name: str,
    solution: Solution = "",
) -> Response:
    """Return grid, layers, levels and ranges of a surface, and the others of the same place."""
    with opened_for(request, workspace, solution) as opened:
        others = same_place(opened, kind, name)
    alike = [dict(zip(("kind", "name"), each, strict=True)) for each in others]
    return json_answer(request, {**found.describe(), "same_place": alike})


@routes.add("GET", f"{_ONE}/window", READ, answers.WINDOW)
def window(request: Request, found: Found, asked: Annotated[Window, Query()]) -> Response:
    """Return a window of a layer at an overview level."""
    if asked.rows * asked.columns > service_of(request).limits.window_pixels:
        raise RequestRefusedError(Refusal.INVALID, "is too large", "window", "ask for parts of it")
    rows = (asked.row, asked.row + asked.rows)
    columns = (asked.column, asked.column + asked.columns)
    return _picture(
        request,
        found,
        asked,
        lambda: found.window(asked.layer, level=asked.level, rows=rows, columns=columns),
    )


@routes.add("GET", f"{_ONE}/tiles/{{level}}/{{row}}/{{column}}", READ, answers.WINDOW)
def tile(
    request: Request,
    found: Found,
    level: int,
    row: int,
    column: int,
    asked: Annotated[Picture, Query()],
) -> Response:
    """Return a tile of 256 × 256 of a layer at an overview level."""
    return _picture(request, found, asked, lambda: found.tile(asked.layer, level, row, column))


@routes.add("GET", f"{_ONE}/value", READ, answers.Value)
def value(request: Request, found: Found, x: Metres, y: Metres) -> Response:
    """Return all layers at a point, metres from the centre: x along Uy, y along −Ux."""
    return json_answer(request, value_at(found, x, y))


@routes.add("GET", f"{_ONE}/profile", READ, answers.Profile)
def along(
    request: Request,
    found: Found,
    begin: Annotated[str, Query(alias="from", max_length=80, examples=["-10,0"])],
    end: Annotated[str, Query(alias="to", max_length=80, examples=["10,0"])],
    layers: Annotated[str, Query(max_length=200, examples=["height,sigma"])] = "",
) -> Response:
    """Return layers along a line between two points x,y in metres, with sigma where there is."""
    wanted = [part.strip() for part in layers.split(",") if part.strip()]
    line = profile(found, _point(begin, "from"), _point(end, "to"), wanted)
    return json_answer(request, line.as_json())


@routes.add("GET", f"{_ONE}/colours", READ, answers.Colours)
def colours(
    request: Request, found: Found, layer: Annotated[str, Query(max_length=32)] = "height"
) -> Response:
    """Return the colours of a layer's pictures, for a legend: red, green and blue, 0 to 255."""
    found.check_layer(layer)
    return json_answer(request, {"layer": layer, "colours": colours_of(layer)})


def _picture(
    request: Request, surface: Surface, asked: Picture, read: Callable[[], FloatArray]
) -> Response:
    """Return a window as PNG or as numbers; nothing is read if the asker has it already."""
    tag = f'"{surface.etag}"'
    headers = {"ETag": tag, "Cache-Control": "private, no-cache", "Vary": "Authorization"}
    if matches(request.headers.get("if-none-match", ""), tag):
        return Response(status_code=304, headers=headers)
    values = read()
    headers |= {"X-Rows": str(values.shape[0]), "X-Columns": str(values.shape[1])}
    if asked.form == "float32":
        body = np.ascontiguousarray(values, dtype="<f4").tobytes()
        return Response(body, media_type=_FLOATS, headers=headers)
    low, high = surface.range(asked.layer) or (0.0, 1.0)
    limits = (low if asked.low is None else asked.low, high if asked.high is None else asked.high)
    body = png_of(values, asked.layer, limits, bits=16 if asked.bits == "16" else 8)
    return Response(body, media_type="image/png", headers=headers)


def _point(text: str, where: str) -> tuple[float, float]:
    """Return the numbers of a text ``x,y``."""
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError as error:
        raise InvalidValueError(f"{text!r} is no point x,y", where) from error
    return x, y
