"""Heights of terrain models of others: GeoTIFF in any projection, above a sphere or spheroid."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import ndimage

from fusion.products.formats.geotiff import read_geotiff
from spcola.arrays import FloatArray
from spcola.errors import FormatError
from spcola.grids import Maplet, MapletGrid
from spcola.grids.gaps import filled

if TYPE_CHECKING:
    from rasterio.io import DatasetReader

_METRES = {"": 1.0, "m": 1.0, "metre": 1.0, "meter": 1.0, "metres": 1.0, "meters": 1.0,
           "km": 1e3, "kilometre": 1e3, "kilometer": 1e3}  # fmt: skip
_SPHEROID = re.compile(r'(?:SPHEROID|ELLIPSOID)\["[^"]*",\s*([-+.\deE]+),\s*([-+.\deE]+)')
# Values beyond this share of the radius are radii, not heights.
_RADII = 0.5
# Steps along Uz to the surface, at most; the last is at most this share of the GSD.
_STEPS, _SETTLED = 30, 1e-3
# Cosine of the angle of Uz and the normal of the spheroid below which they have no common height.
_STEEPEST = 0.2
# Pixels read around those on which the start lies, and share of their number.
_MARGIN, _MARGIN_SHARE = 8, 0.5
_SAMPLE = 64


@dataclass(frozen=True)
class TerrainRaster:
    """A terrain model in a GeoTIFF that spcola did not write: its first band.

    Attributes
    ----------
    path : Path
    equator, pole : float
        Half-axes of the spheroid above which its heights are, metres.
    radii : bool
        Whether its values are distances from the centre, not heights.
    scale, offset : float
        Metres = scale · value + offset.
    gsd : float
        Side of a square of the area of a pixel, metres.
    """

    path: Path
    equator: float
    pole: float
    radii: bool
    scale: float
    offset: float
    gsd: float

    @classmethod
    def open(cls, path: Path) -> TerrainRaster | Maplet:
        """Open a GeoTIFF; one of spcola is a maplet (:func:`read_geotiff`).

        Parameters
        ----------
        path : Path

        Raises
        ------
        FormatError
            If it is no GeoTIFF, or has no projection, no spheroid, no known unit, or no value.
        """
        with _opened(path) as raster:
            if "SPCOLA_FRAME" in raster.tags():
                return read_geotiff(path)
            equator, pole = _half_axes(raster, path)
            unit = (raster.units[0] or "").strip().lower()
            if unit not in _METRES:
                raise FormatError(f"has heights in {raster.units[0]!r}, m or km are known", path)
            scale, offset = (_METRES[unit] * v for v in (raster.scales[0], raster.offsets[0]))
            shape = tuple(min(_SAMPLE, side) for side in raster.shape)
            values = scale * _values(raster.read(1, out_shape=shape, masked=True)) + offset
            if not np.isfinite(values).any():
                raise FormatError("has no height in its first band", path)
            # A degree of longitude is that of the equator: a square is as wide on the ground there.
            step = np.radians(equator) if raster.crs.is_geographic else _linear(raster)
            area = abs(raster.transform.determinant)
            radii = bool(np.nanmedian(np.abs(values)) > _RADII * pole)
            gsd = float(np.sqrt(area) * step)
        return cls(path, equator, pole, radii, float(scale), float(offset), gsd)

    def heights(self, start: Maplet) -> FloatArray:
        """Return the heights (R, C) of its surface on the grid of a maplet, metres along Uz.

        NaN where it has none. A pixel is a height of its middle; between them it is bilinear.
        Pixels finer than the grid are averaged to about its GSD.

        Parameters
        ----------
        start : Maplet
            From whose heights the surface is searched.

        Raises
        ------
        FormatError
            If the file cannot be read any more.
        """
        grid, height = start.grid, filled(start.height)
        with _opened(self.path) as raster:
            window = _Window.around(raster, self, grid, height)
        if window is None:
            return np.full(grid.shape, np.nan)
        for _ in range(_STEPS):
            step = self._step(window, grid, height)
            height = height + np.nan_to_num(step)
            known = step[np.isfinite(step)]
            if not known.size or np.abs(known).max() < _SETTLED * grid.gsd:
                break
        settled = np.abs(self._step(window, grid, height)) < grid.gsd * 0.1
        return np.where(settled, height, np.nan)

    def _step(self, window: _Window, grid: MapletGrid, height: FloatArray) -> FloatArray:
        """Return how far (R, C) along Uz its surface is from heights, metres; NaN outside."""
        points = grid.points(height)
        longitude, latitude, above = self.geodetic(points)
        if self.radii:
            above = np.linalg.norm(points, axis=-1)
            normal = points / above[..., None]
        else:
            cosine = np.cos(latitude)
            normal = np.stack(
                [cosine * np.cos(longitude), cosine * np.sin(longitude), np.sin(latitude)], axis=-1
            )
        along = normal @ grid.uz
        values = self.scale * window.at(longitude, latitude) + self.offset
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(along > _STEEPEST, (values - above) / along, np.nan)

    def geodetic(self, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return longitude, geodetic latitude (radians) and height (metres) of points (…, 3)."""
        x, y, z = np.moveaxis(points, -1, 0)
        across = np.hypot(x, y)
        flat = 1.0 - (self.pole / self.equator) ** 2
        latitude = np.arctan2(z, across * (1.0 - flat))
        for _ in range(8):
            normal = self.equator / np.sqrt(1.0 - flat * np.sin(latitude) ** 2)
            latitude = np.arctan2(z + flat * normal * np.sin(latitude), across)
        normal = self.equator / np.sqrt(1.0 - flat * np.sin(latitude) ** 2)
        # Along the normal, which is exact at poles too.
        above = across * np.cos(latitude) + z * np.sin(latitude) - self.equator**2 / normal
        return np.arctan2(y, x), latitude, above


@dataclass(frozen=True, eq=False)
class _Window:
    """A part of a raster in memory."""

    values: FloatArray
    inverse: Any
    project: Any

    @classmethod
    def around(
        cls, raster: DatasetReader, terrain: TerrainRaster, grid: MapletGrid, height: FloatArray
    ) -> _Window | None:
        """Read the pixels around a surface; None if there are none."""
        project = _Projection.of(raster, terrain, grid.center)
        longitude, latitude, _ = terrain.geodetic(grid.points(height))
        column, row = ~raster.transform @ project(longitude, latitude)
        factor = max(1, int(grid.gsd / terrain.gsd))
        # Columns of a raster that goes round the body follow each other without end.
        pixel = abs(raster.transform.a)
        around = abs(pixel * raster.width - project.turn) <= 0.5 * pixel
        while around and raster.width % factor:
            factor -= 1
        rows = _span(row, raster.height, factor)
        columns = _span(column, None if around else raster.width, factor)
        if rows is None or columns is None:
            return None
        parts = [_read(raster, rows, part, factor) for part in _wrapped(columns, raster.width)]
        values = np.concatenate(parts, axis=1)
        shape = rows[1] - rows[0], columns[1] - columns[0]
        scale = raster.transform.scale(shape[1] / values.shape[1], shape[0] / values.shape[0])
        within = raster.transform.translation(columns[0], rows[0]) @ scale
        return cls(values, ~(raster.transform @ within), project)

    def at(self, longitude: FloatArray, latitude: FloatArray) -> FloatArray:
        """Return values at places in radians, bilinearly; NaN outside, or next to a gap."""
        column, row = self.inverse @ self.project(longitude, latitude)
        places = np.stack([row - 0.5, column - 0.5])
        places = np.where(np.isfinite(places), places, -1e9)
        found: FloatArray = ndimage.map_coordinates(
            self.values, places, order=1, mode="constant", cval=np.nan
        )
        return found


@dataclass(frozen=True, eq=False)
class _Projection:
    """Places in the coordinates of a raster.

    Where these go round the body, `turn` in each, places are within half a turn of `middle`.
    """

    source: Any
    target: Any
    middle: float
    turn: float

    @classmethod
    def of(cls, raster: DatasetReader, terrain: TerrainRaster, center: FloatArray) -> _Projection:
        """Return the projection of a raster for places around `center` (3,), metres."""
        from rasterio.crs import CRS  # noqa: PLC0415

        source = CRS.from_proj4(
            f"+proj=longlat +a={terrain.equator!r} +b={terrain.pole!r} +no_defs"
        )
        text, turn = raster.crs.to_dict(), np.inf
        if raster.crs.is_geographic:
            turn = 360.0
        elif text.get("proj") == "eqc":
            true = np.cos(np.radians(float(text.get("lat_ts", 0.0))))
            turn = 2.0 * np.pi * terrain.equator * true / _linear(raster)
        plain = cls(source, raster.crs, 0.0, np.inf)
        longitude, latitude, _ = terrain.geodetic(center[None])
        middle = float(plain(longitude, latitude)[0][0])
        if np.isfinite(turn):
            left = float(raster.bounds.left)
            middle = left + (middle - left) % turn
        return cls(source, raster.crs, middle, turn)

    def __call__(self, longitude: FloatArray, latitude: FloatArray) -> tuple[FloatArray, ...]:
        from rasterio.warp import transform  # noqa: PLC0415

        degrees = np.degrees(longitude).ravel(), np.degrees(latitude).ravel()
        x, y = (np.array(v) for v in transform(self.source, self.target, *degrees))
        if np.isfinite(self.turn):
            half = 0.5 * self.turn
            x = self.middle + (x - self.middle + half) % self.turn - half
        return x.reshape(longitude.shape), y.reshape(longitude.shape)


def _span(place: FloatArray, side: int | None, factor: int) -> tuple[int, int] | None:
    """Return first and last + 1 of the pixels around places, multiples of `factor` apart.

    None if there are none of `side` pixels; None as `side`: they have no end.
    """
    known = place[np.isfinite(place)]
    if not known.size:
        return None
    margin = _MARGIN * factor + _MARGIN_SHARE * float(np.ptp(known))
    first = int(np.floor((known.min() - margin) / factor)) * factor
    last = int(np.ceil((known.max() + margin) / factor)) * factor
    if side is not None:
        first, last = max(first, 0), min(last, side)
    return (first, last) if last > first else None


def _wrapped(span: tuple[int, int], width: int) -> Iterator[tuple[int, int]]:
    """Yield the parts of a span of columns, each within 0 to `width`."""
    first, last = span
    while first < last:
        turn = first // width
        end = min(last, (turn + 1) * width)
        yield first - turn * width, end - turn * width
        first = end


def _read(
    raster: DatasetReader, rows: tuple[int, int], columns: tuple[int, int], factor: int
) -> FloatArray:
    """Return the values in rows and columns, averaged over `factor` pixels a side."""
    from rasterio.enums import Resampling  # noqa: PLC0415
    from rasterio.windows import Window  # noqa: PLC0415

    (top, bottom), (left, right) = rows, columns
    read = raster.read(
        1,
        window=Window(left, top, right - left, bottom - top),
        out_shape=(-(-(bottom - top) // factor), -(-(right - left) // factor)),
        masked=True,
        resampling=Resampling.average,
    )
    return _values(read)


@contextmanager
def _opened(path: Path) -> Iterator[DatasetReader]:
    """Open a raster; all that its library refuses is a FormatError."""
    import rasterio  # noqa: PLC0415
    from rasterio.errors import RasterioError  # noqa: PLC0415

    try:
        with rasterio.open(path, driver="GTiff") as raster:
            yield raster
    except (RasterioError, OSError) as error:
        raise FormatError(f"cannot be read as GeoTIFF ({error})", path) from error


def _half_axes(raster: DatasetReader, path: Path) -> tuple[float, float]:
    """Return equatorial and polar half-axes of the spheroid, metres."""
    if raster.crs is None:
        raise FormatError("states no projection", path, "write one: gdal_translate -a_srs")
    found = _SPHEROID.search(raster.crs.to_wkt())
    equator, flattening = (float(text) for text in found.groups()) if found else (0.0, 0.0)
    if not equator > 0.0:
        raise FormatError("states no radius of its body", path, "write one: gdal_translate -a_srs")
    return equator, equator * (1.0 - 1.0 / flattening if flattening else 1.0)


def _linear(raster: DatasetReader) -> float:
    """Return metres a unit of the projection."""
    return float(raster.crs.linear_units_factor[1])


def _values(read: Any) -> FloatArray:
    return np.asarray(read.astype(np.float64).filled(np.nan))
