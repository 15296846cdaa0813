"""Routes of surfaces: what there is, windows, tiles, values at a point, profiles."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from fastapi import Depends, Query
from pydantic import BaseModel, Field
from starlette.requests import Request
from starlette.responses import Response

from fusion.service.api.access import READ, Routes
from fusion.service.api.answers import by_tag, json_answer
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
from spcola.arrays import AnyArray, FloatArray
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


@dataclass(frozen=True)
class _Asked:
    """Which surface is asked for."""

    request: Request
    workspace: str
    kind: SurfaceKind
    name: str
    solution: str

    def open(self) -> Surface:
        """Open it; what is not there is answered with 404."""
        with opened_for(self.request, self.workspace, self.solution) as opened:
            return open_surface(opened, self.kind, self.name, cache=service_of(self.request).cache)


# Asynchronous, as it only collects: what waits for files does so in the thread of the route.
async def _asked_for(
    request: Request, workspace: str, kind: SurfaceKind, name: str, solution: Solution = ""
) -> _Asked:
    return _Asked(request, workspace, kind, name, solution)


Wanted = Annotated[_Asked, Depends(_asked_for)]


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
def surface(request: Request, wanted: Wanted) -> Response:
    """Return grid, layers, levels and ranges of a surface, and the others of the same place."""
    found = wanted.open()
    with opened_for(request, wanted.workspace, wanted.solution) as opened:
        others = same_place(opened, wanted.kind, wanted.name)
    alike = [dict(zip(("kind", "name"), each, strict=True)) for each in others]
    return json_answer(request, {**found.describe(), "same_place": alike})


@routes.add("GET", f"{_ONE}/window", READ, answers.WINDOW)
def window(request: Request, wanted: Wanted, asked: Annotated[Window, Query()]) -> Response:
    """Return a window of a layer at an overview level."""
    if asked.rows * asked.columns > service_of(request).limits.window_pixels:
        raise RequestRefusedError(Refusal.INVALID, "is too large", "window", "ask for parts of it")
    rows = (asked.row, asked.row + asked.rows)
    columns = (asked.column, asked.column + asked.columns)
    found = wanted.open()

    def read() -> bytes:
        values = found.window(asked.layer, level=asked.level, rows=rows, columns=columns)
        return _content(found, asked, values)

    return _picture(request, found, asked, (asked.rows, asked.columns), read)


@routes.add("GET", f"{_ONE}/tiles/{{level}}/{{row}}/{{column}}", READ, answers.WINDOW)
def tile(
    request: Request,
    wanted: Wanted,
    level: int,
    row: int,
    column: int,
    asked: Annotated[Picture, Query()],
) -> Response:
    """Return a tile of 256 × 256 of a layer at an overview level."""
    found = wanted.open()

    def drawn() -> dict[Hashable, AnyArray]:
        content = _content(found, asked, found.tile(asked.layer, level, row, column))
        return {0: np.frombuffer(content, dtype=np.uint8)}

    def read() -> bytes:
        # Who looks at a map asks for the same tiles as the one before: a drawn one is kept.
        key = (found.etag, level, row, column, *asked.model_dump().values())
        return service_of(request).cache.find(key, 0, drawn).tobytes()

    return _picture(request, found, asked, (found.tile_cells, found.tile_cells), read)


@routes.add("GET", f"{_ONE}/value", READ, answers.Value)
def value(request: Request, wanted: Wanted, x: Metres, y: Metres) -> Response:
    """Return all layers at a point, metres from the centre: x along Uy, y along −Ux."""
    return json_answer(request, value_at(wanted.open(), x, y))


@routes.add("GET", f"{_ONE}/profile", READ, answers.Profile)
def along(
    request: Request,
    wanted: Wanted,
    begin: Annotated[str, Query(alias="from", max_length=80, examples=["-10,0"])],
    end: Annotated[str, Query(alias="to", max_length=80, examples=["10,0"])],
    layers: Annotated[str, Query(max_length=200, examples=["height,sigma"])] = "",
) -> Response:
    """Return layers along a line between two points x,y in metres, with sigma where there is."""
    named = [part.strip() for part in layers.split(",") if part.strip()]
    line = profile(wanted.open(), _point(begin, "from"), _point(end, "to"), named)
    return json_answer(request, line.as_json())


@routes.add("GET", f"{_ONE}/colours", READ, answers.Colours)
def colours(
    request: Request, wanted: Wanted, layer: Annotated[str, Query(max_length=32)] = "height"
) -> Response:
    """Return the colours of a layer's pictures, for a legend: red, green and blue, 0 to 255."""
    wanted.open().check_layer(layer)
    return json_answer(request, {"layer": layer, "colours": colours_of(layer)})


def _content(surface: Surface, asked: Picture, values: FloatArray) -> bytes:
    """Return values as PNG or as numbers."""
    if asked.form == "float32":
        return np.ascontiguousarray(values, dtype="<f4").tobytes()
    low, high = surface.range(asked.layer) or (0.0, 1.0)
    limits = (low if asked.low is None else asked.low, high if asked.high is None else asked.high)
    return png_of(values, asked.layer, limits, bits=16 if asked.bits == "16" else 8)


def _picture(
    request: Request,
    surface: Surface,
    asked: Picture,
    shape: tuple[int, int],
    read: Callable[[], bytes],
) -> Response:
    """Return a picture of some rows and columns; nothing is read if the asker has it already."""
    headers = {"X-Rows": str(shape[0]), "X-Columns": str(shape[1])}
    media_type = _FLOATS if asked.form == "float32" else "image/png"
    return by_tag(request, surface.etag, media_type, read, headers)


def _point(text: str, where: str) -> tuple[float, float]:
    """Return the numbers of a text ``x,y``."""
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError as error:
        raise InvalidValueError(f"{text!r} is no point x,y", where) from error
    return x, y
