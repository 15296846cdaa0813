"""GeoTIFF of a maplet, in a projection in which its grid is exact.

A maplet's reference plane ``V + x Ux + y Uy`` (Gaskell et al., eq. 15 with h = 0) is all points P
with ``P · Uz = D``, D = V · Uz. The **gnomonic** projection of a sphere of radius D, centred on
the direction of Uz, maps a direction to the point where its ray from the body's origin meets
that plane. So the grid is an affine map (with rotation, as Ux and Uy seldom run south and
east) of the projected coordinates, whatever the tilt of the plane against the local sphere, and:

* **a point of the reference plane** has exactly the longitude and latitude that the CRS gives its
  pixel centre (planetocentric; to rounding, below 1e-9 degree);
* **a point of the surface**, at height h above the plane, is shown at the foot of its normal. Its
  own longitude and latitude are those of the position ``ρ D / (D + h)`` from the projection
  centre instead of ρ: it is displaced by ``ρ h / (D + h)``, where ρ is the distance of the pixel
  from the point where Uz, drawn from the origin, meets the plane (5 cm for h = 1 m at ρ = 12 m on
  a body of 250 m). Where that matters, add the heights: ``maplet.points()``.

The sphere of radius D is the datum of the CRS, not the figure of the body.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fusion.products.formats.layers import (
    DESCRIPTIONS,
    frame_text,
    layers_of,
    maplet_of,
    parse_frame,
)
from fusion.products.manifest import Provenance
from spcola import atomic
from spcola.arrays import FloatArray
from spcola.errors import FormatError, InvalidValueError
from spcola.grids import Maplet, MapletGrid
from spcola.math import lon_lat_deg

if TYPE_CHECKING:
    from affine import Affine

_TILE = 256
_SMALLEST_OVERVIEW = 32


def crs_wkt(grid: MapletGrid, body: str) -> str:
    """Return the gnomonic CRS of the grid's reference plane as WKT.

    Raises
    ------
    InvalidValueError
        If the plane faces the origin or goes through it (D ≤ 0): it has no such projection.
    """
    distance = float(grid.center @ grid.uz)
    if distance <= 0:
        raise InvalidValueError("the reference plane does not face away from the origin", "grid")
    longitude, latitude = lon_lat_deg(grid.uz)
    label = "".join(c for c in body if c.isalnum() or c in " -_") or "body"
    return (
        f'PROJCS["{label} maplet plane (gnomonic)",'
        f'GEOGCS["{label} planetocentric",'
        f'DATUM["{label} sphere to the maplet plane",'
        f'SPHEROID["{label} sphere to the maplet plane",{distance!r},0]],'
        'PRIMEM["Reference meridian",0],UNIT["degree",0.017453292519943295]],'
        'PROJECTION["Gnomonic"],'
        f'PARAMETER["latitude_of_origin",{float(latitude)!r}],'
        f'PARAMETER["central_meridian",{float(longitude)!r}],'
        'PARAMETER["false_easting",0],PARAMETER["false_northing",0],'
        'UNIT["metre",1],AXIS["Easting",EAST],AXIS["Northing",NORTH]]'
    )


def geotransform(grid: MapletGrid) -> Affine:
    """Return the affine map from (column, row) of the raster to (easting, northing), metres.

    Columns run along Uy and rows along Ux: for a maplet of the usual orientation (Uy east, Ux
    south) the image has north at its top. Whole numbers are corners of pixels; the grid point
    (m, n) is the centre of the pixel in column m + q and row n + q.
    """
    from affine import Affine  # noqa: PLC0415  (comes with rasterio, which is imported late)

    east, north = _plane_axes(grid)
    per_column = grid.gsd * np.array([grid.uy @ east, grid.uy @ north])
    per_row = grid.gsd * np.array([grid.ux @ east, grid.ux @ north])
    center = np.array([grid.center @ east, grid.center @ north])
    origin = center - (grid.half_size + 0.5) * (per_column + per_row)
    return Affine(per_column[0], per_row[0], origin[0], per_column[1], per_row[1], origin[1])


def write_geotiff(path: str | Path, maplet: Maplet, provenance: Provenance) -> None:
    """Write a maplet or bigmap as GeoTIFF: 32-bit floats, tiled, with overviews.

    Bands: height (m), sigma (m), relative albedo and, for a fused maplet, lidar count and source;
    NaN where there is none. Overviews take the nearest point, as codes of sources and missing
    points cannot be averaged. The dataset's tags hold the frame and the provenance as JSON.

    Parameters
    ----------
    path : str or Path
    maplet : Maplet
    provenance : Provenance
        What it was made from.

    Raises
    ------
    InvalidValueError
        If the plane has no projection (see :func:`crs_wkt`).
    WorkspaceError
        If the file cannot be written.
    """
    import rasterio  # noqa: PLC0415  (an eighth of a second at start-up)
    from rasterio.enums import Resampling  # noqa: PLC0415

    layers = layers_of(maplet)
    size = maplet.grid.size
    profile: dict[str, Any] = {
        "driver": "GTiff", "dtype": "float32", "count": len(layers), "width": size,
        "height": size, "crs": crs_wkt(maplet.grid, provenance.body),
        "transform": geotransform(maplet.grid), "nodata": np.nan, "tiled": True,
        "blockxsize": _TILE, "blockysize": _TILE, "compress": "deflate", "predictor": 3,
        "interleave": "band",
    }  # fmt: skip
    levels = [2**k for k in range(1, 16) if size >> k >= _SMALLEST_OVERVIEW] or [2]
    with atomic.replacing(path) as temporary:
        with rasterio.open(temporary, "w", **profile) as raster:
            for band, (name, layer) in enumerate(layers.items(), start=1):
                raster.write(layer.T.astype(np.float32), band)
                raster.set_band_description(band, name)
                raster.update_tags(band, DESCRIPTION=DESCRIPTIONS[name])
            raster.update_tags(SPCOLA_FRAME=frame_text(maplet), SPCOLA_PROVENANCE=provenance.text())
        with rasterio.open(temporary, "r+") as raster:
            raster.build_overviews(levels, Resampling.nearest)


def read_geotiff(path: str | Path) -> Maplet:
    """Read a file of :func:`write_geotiff`; values are 32-bit floats.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        If spcola did not write it, or its bands do not fit the frame in its tags.
    """
    import rasterio  # noqa: PLC0415
    from rasterio.errors import RasterioError  # noqa: PLC0415

    try:
        with rasterio.open(path) as raster:
            tags, names = raster.tags(), raster.descriptions
            bands = raster.read().astype(np.float64)
    except (RasterioError, OSError) as error:
        raise FormatError(f"cannot be read as GeoTIFF ({error})", path) from error
    if "SPCOLA_FRAME" not in tags:
        raise FormatError("has no tag SPCOLA_FRAME: it was not written by spcola", path)
    name, grid, center_sigma = parse_frame(tags["SPCOLA_FRAME"], f"{path}: SPCOLA_FRAME")
    layers = {str(key): band.T for key, band in zip(names, bands, strict=True)}
    missing = [key for key in ("height", "sigma", "albedo") if key not in layers]
    if missing or not set(layers) <= set(DESCRIPTIONS):
        raise FormatError(
            f"has bands {', '.join(map(str, names))}: it was not written by spcola", path
        )
    try:
        return maplet_of(name, grid, layers, center_sigma)
    except InvalidValueError as error:
        raise FormatError(str(error), path) from error


def _plane_axes(grid: MapletGrid) -> tuple[FloatArray, FloatArray]:
    """Return unit vectors east and north (3,) at the direction of Uz: axes of the projection."""
    longitude, latitude = np.radians(lon_lat_deg(grid.uz))
    east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    north = np.array([
        -np.sin(latitude) * np.cos(longitude),
        -np.sin(latitude) * np.sin(longitude),
        np.cos(latitude),
    ])  # fmt: skip
    return east, north
