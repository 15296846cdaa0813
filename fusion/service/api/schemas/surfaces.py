"""Answers about surfaces and what lies where on the body."""

from __future__ import annotations

from fusion.service.api.schemas.base import Form, Media, Number, listing
from fusion.service.views.surfaces import SurfaceKind

PIXELS = {"X-Rows": "Rows of the window.", "X-Columns": "Columns of the window."}
WINDOW = Media(("application/octet-stream", "image/png"), PIXELS)
FLOATS = Media(("application/octet-stream",))


class Place(Form):
    """A point of the body."""

    longitude_deg: Number
    latitude_deg: Number
    radius_m: Number


class Grid(Place):
    """The frame of a grid; `axes` are Ux (down), Uy (right) and Uz."""

    center_m: list[float]
    axes: list[list[float]]
    gsd_m: float
    size: int
    side_m: float


class SurfaceName(Form):
    """Kind and name of a surface."""

    kind: SurfaceKind
    name: str


class Level(Form):
    """An overview level: grid points on a cell's side, cells and tiles on a side."""

    level: int
    gsd_m: float
    cells: int
    tiles: int


class Layer(Form):
    """A layer, how its levels are made, and its range of colours."""

    name: str
    text: str
    unit: str
    levels: str
    colours: str
    range: list[float] | None


class Described(Grid):
    """Grid, layers, levels and ranges of a surface, and the others of the same place."""

    kind: SurfaceKind
    name: str
    tile: int
    levels: list[Level]
    layers: list[Layer]
    etag: str
    same_place: list[SurfaceName]


class Value(Place):
    """All layers at a point."""

    x_m: float
    y_m: float
    layers: dict[str, Number]


class Profile(Form):
    """Layers along a line."""

    distance_m: list[Number]
    x_m: list[Number]
    y_m: list[Number]
    longitude_deg: list[Number]
    latitude_deg: list[Number]
    layers: dict[str, list[Number]]


class Colours(Form):
    """The colours of a layer: red, green and blue, 0 to 255."""

    layer: str
    colours: list[list[int]]


class ShapeLayer(Form):
    """A layer on the shape, and of which kind of surface it is taken."""

    name: str
    text: str
    unit: str
    colours: str
    of: SurfaceKind
    surfaces: int


class Outlines(Form):
    """Squares of surfaces on the body, as columns."""

    kind: SurfaceKind
    name: list[str]
    center_m: list[list[Number]]
    axes: list[list[list[Number]]]
    side_m: list[Number]
    gsd_m: list[Number]


class Footprints(Form):
    """Places and sizes of surfaces, as columns."""

    name: list[str]
    longitude_deg: list[Number]
    latitude_deg: list[Number]
    radius_m: list[Number]
    side_m: list[Number]
    gsd_m: list[Number]


class ImagePlaces(Form):
    """Points below the spacecraft, as columns; `all` counts the images."""

    name: list[str]
    longitude_deg: list[Number]
    latitude_deg: list[Number]
    distance_m: list[Number]
    all: int


class Density(Form):
    """Returns on each square metre; rows from the south, columns from 0° east."""

    step_deg: float
    returns: int
    counted: int
    density_per_m2: list[list[Number]]


class Coverage(Form):
    """Where surfaces, images and returns lie."""

    maplets: Footprints
    mapolas: Footprints
    fused: Footprints
    bigmaps: Footprints
    images: ImagePlaces
    returns: Density


SURFACES = listing("surfaces", SurfaceName)
SHAPE_LAYERS = listing("layers", ShapeLayer)
