"""Values of a surface at points and along lines, between the grid points."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fusion.service.views.surfaces.layers import LAYERS
from fusion.service.views.surfaces.levels import Rule
from fusion.service.views.surfaces.surface import SHADED, Surface
from spcola.arrays import AnyArray, FloatArray, IntArray
from spcola.errors import InvalidValueError
from spcola.math import lon_lat_deg

_MOST_SAMPLES = 8192
# Grid points that are rather read than picked from the file one by one.
_READ_AT_ONCE = 1 << 18


def value_at(surface: Surface, x: float, y: float) -> dict[str, Any]:
    """Return all layers of a surface at a point, in JSON types.

    Heights, albedo and differences are bilinear between four grid points; so is sigma, an upper
    bound of that of the height, equal to it if their errors are common. Count, source and slope
    are those of the nearest grid point. NaN where a grid point that is needed is unknown.

    Parameters
    ----------
    surface : Surface
    x, y : float
        Metres from the centre, along Uy and along −Ux.

    Raises
    ------
    InvalidValueError
        If the point is not a finite one on the grid.
    """
    values = sampled(surface, np.array([x]), np.array([y]), _read_layers(surface))
    found = {name: float(layer[0]) for name, layer in values.items()}
    if "slope" in surface.layers:
        row, column = (int(np.rint(each[0])) for each in _places(surface, [x], [y]))
        window = surface.window("slope", rows=(row, row + 1), columns=(column, column + 1))
        found["slope"] = float(window[0, 0])
    longitude, latitude, radius = (float(each[0]) for each in _on_body(surface, [x], [y], values))
    place = {"longitude_deg": longitude, "latitude_deg": latitude, "radius_m": radius}
    return {"x_m": x, "y_m": y, **place, "layers": found}


@dataclass(frozen=True, eq=False)
class Profile:
    """Layers along a straight line on the plane of a grid.

    Attributes
    ----------
    distance, x, y : (N,) ndarrays
        Metres from the beginning of the line, and from the centre of the grid.
    longitude_deg, latitude_deg : (N,) ndarrays
        Of the surface; of the plane where its height is unknown.
    layers : mapping of str to (N,) ndarray
        NaN where unknown.
    """

    distance: FloatArray
    x: FloatArray
    y: FloatArray
    longitude_deg: FloatArray
    latitude_deg: FloatArray
    layers: Mapping[str, FloatArray]

    def as_json(self) -> dict[str, Any]:
        """Return it in JSON types; keys carry units."""
        return {
            "distance_m": self.distance,
            "x_m": self.x,
            "y_m": self.y,
            "longitude_deg": self.longitude_deg,
            "latitude_deg": self.latitude_deg,
            "layers": dict(self.layers),
        }


def profile(
    surface: Surface,
    begin: tuple[float, float],
    end: tuple[float, float],
    layers: Sequence[str] = (),
) -> Profile:
    """Return layers along a line, sampled once a GSD (at most 8192 times), as :func:`value_at`.

    Parameters
    ----------
    surface : Surface
    begin, end : (float, float)
        x and y, metres from the centre, along Uy and along −Ux; on the grid.
    layers : sequence of str
        By default all but hillshade and slope. The band of one sigma is height ± sigma.

    Raises
    ------
    InvalidValueError
        If an end is not on the grid, or a layer is not there.
    """
    length = float(np.hypot(end[0] - begin[0], end[1] - begin[1]))
    if not np.isfinite(length):
        raise InvalidValueError("is no line between finite points", "profile")
    count = int(np.clip(np.ceil(length / surface.grid.gsd) + 1, 2, _MOST_SAMPLES))
    x, y = (np.linspace(begin[k], end[k], count) for k in (0, 1))
    there = _read_layers(surface)
    for name in layers:
        if name not in there:
            what = f"has no layer {name!r} for a profile"
            raise InvalidValueError(what, surface.name, f"there are: {', '.join(there)}")
    values = sampled(surface, x, y, dict.fromkeys(["height", *(layers or there)]))
    longitude, latitude, _ = _on_body(surface, x, y, values)
    shown = {name: values[name] for name in (layers or there)}
    return Profile(np.linspace(0.0, length, count), x, y, longitude, latitude, shown)


def sampled(
    surface: Surface, x: FloatArray, y: FloatArray, layers: Sequence[str] | Mapping[str, Any]
) -> dict[str, FloatArray]:
    """Return layers (N,) of a surface at points `x`, `y` (N,) of its grid, metres.

    Raises
    ------
    InvalidValueError
        If a point lies outside the grid.
    """
    rows, columns = _places(surface, x, y)
    corner = [np.clip(np.floor(each).astype(np.int64), 0, None) for each in (rows, columns)]
    top, left = (np.minimum(each, surface.grid.size - 2) for each in corner)
    down, right = rows - top, columns - left
    found: dict[str, FloatArray] = {}
    for name in layers:
        read = _reader(surface, name, rows, columns)
        if LAYERS[name].rule in (Rule.SUM, Rule.NEAREST):
            place = (np.rint(rows).astype(np.int64), np.rint(columns).astype(np.int64))
            found[name] = read(*place).astype(np.float64)
            continue
        total = np.zeros(len(rows))
        for i, share in ((0, 1.0 - down), (1, down)):
            for j, part in ((0, 1.0 - right), (1, right)):
                weight = share * part
                values = read(top + i, left + j)
                # A grid point without weight may be unknown.
                total += np.where(weight > 0, weight * values, 0.0)
        found[name] = total
    if "height" in found:
        for name in {"sigma", "albedo"} & found.keys():
            found[name] = np.where(np.isfinite(found["height"]), found[name], np.nan)
    return found


def _reader(
    surface: Surface, layer: str, rows: FloatArray, columns: FloatArray
) -> Callable[[IntArray, IntArray], AnyArray]:
    """Return what gives a layer at grid points (rows, columns) around some places.

    All in the rectangle around them are read at once if these are few.
    """
    last = surface.grid.size
    low = [int(np.floor(each.min())) for each in (rows, columns)]
    high = [min(int(np.floor(each.max())) + 2, last) for each in (rows, columns)]
    low = [min(each, last - 2) for each in low]
    if (high[0] - low[0]) * (high[1] - low[1]) > max(_READ_AT_ONCE, 16 * len(rows)):
        return lambda i, j: surface.source.read(layer, (j, i))
    part = surface.source.read(layer, (slice(low[1], high[1]), slice(low[0], high[0])))
    return lambda i, j: part[j - low[1], i - low[0]]


def _read_layers(surface: Surface) -> tuple[str, ...]:
    """Return the layers that are not computed from heights."""
    return tuple(name for name in surface.layers if name not in SHADED)


def _places(surface: Surface, x: Any, y: Any) -> tuple[FloatArray, FloatArray]:
    """Return rows and columns (N,) of points, as fractions, refused outside the grid."""
    grid = surface.grid
    # A number near the largest one there is overflows: that is outside too.
    with np.errstate(over="ignore"):
        rows = grid.half_size - np.asarray(y, dtype=np.float64) / grid.gsd
        columns = grid.half_size + np.asarray(x, dtype=np.float64) / grid.gsd
    last = grid.size - 1
    # A client that computes the rim with other digits means the rim.
    rim = 1e-6
    for each in (rows, columns):
        if not ((each >= -rim) & (each <= last + rim)).all():
            half = grid.half_size * grid.gsd
            what = f"is not on the grid, within ± {half:.10g} m of its centre"
            raise InvalidValueError(what, f"{surface.name}: point")
    return np.clip(rows, 0, last), np.clip(columns, 0, last)


def _on_body(
    surface: Surface, x: Any, y: Any, values: Mapping[str, FloatArray]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return longitude and latitude, degrees, and radius (N,) of points of a surface.

    Those of the plane, without a radius, where the height is unknown.
    """
    grid = surface.grid
    unknown = np.full(len(np.asarray(x)), np.nan)
    height = values.get("height", unknown)
    plane = grid.center + np.outer(x, grid.uy) - np.outer(y, grid.ux)
    points = plane + np.nan_to_num(height)[:, None] * grid.uz
    longitude, latitude = lon_lat_deg(points)
    radius = np.where(np.isfinite(height), np.linalg.norm(points, axis=1), np.nan)
    return longitude, latitude, radius
