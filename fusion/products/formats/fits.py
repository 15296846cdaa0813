"""ALTWG FITS DTMs: a cube of planes in double precision.

The primary cube is what readers of the altimetry working group expect: rows along Ux, columns
along Uy, lengths in kilometres. Conversion to kilometres rounds, and a FITS card has twenty
characters for a number. Two small extensions therefore have the heights in metres (``HEIGHT_M``)
and the frame (``FRAME``), so that reading is bit-identical. Files of other writers have neither
and are read from the cube.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fusion.products.formats.layers import layers_of, maplet_of, quality_of
from fusion.products.manifest import Provenance
from spcola import __version__, atomic
from spcola.arrays import AnyArray, FloatArray
from spcola.errors import FormatError, InvalidValueError
from spcola.formats.images import reading_fits
from spcola.formats.text import KM
from spcola.grids import Maplet, MapletGrid
from spcola.math import lon_lat_deg

_PLANES: tuple[tuple[str, str], ...] = (
    ("Latitude of vertices", "[deg]"),
    ("Longitude of vertices", "[deg]"),
    ("Radius of vertices", "[km]"),
    ("X coordinate of vertices", "[km]"),
    ("Y coordinate of vertices", "[km]"),
    ("Z coordinate of vertices", "[km]"),
    ("Height relative to normal plane", "[km]"),
    ("Relative albedo", ""),
    ("Sigma", "[m] one standard deviation of the height"),
    ("Quality", "0 none 1 filled 2 image or lidar 3 both"),
)
_FUSED_PLANES: tuple[tuple[str, str], ...] = (
    ("Number of OLA points used", "lidar returns in the cell"),
    ("Source", "0 none 1 image 2 lidar 3 both 4 filled"),
)
# Integers from here on are not exact in double precision.
_MOST = 2.0**53
_NEEDED = ("Height relative to normal plane", "Relative albedo", "Sigma")


def write_fits_dtm(
    path: str | Path,
    maplet: Maplet,
    provenance: Provenance,
    *,
    source: str = "SPO",
    version: int = 1,
) -> None:
    """Write a maplet or bigmap as an ALTWG FITS DTM, whole or not at all.

    Parameters
    ----------
    path : str or Path
        For its name see :func:`fusion.products.naming.product_stem`.
    maplet : Maplet
        A fused maplet adds planes of lidar count and source, and has quality (NaN for a plain
        maplet).
    provenance : Provenance
        Written to the card PROVENAN as JSON.
    source : str
        DATASRC.
    version : int
        MAP_VER.

    Raises
    ------
    WorkspaceError
        If the file cannot be written.
    """
    from astropy.io import fits  # noqa: PLC0415  (a quarter of a second at start-up)

    planes = _PLANES + (_FUSED_PLANES if "source" in layers_of(maplet) else ())
    primary = fits.PrimaryHDU(_cube(maplet).astype(">f8"))
    for number, (name, unit) in enumerate(planes, start=1):
        primary.header[f"PLANE{number}"] = (name, unit)
    for key, (value, comment) in _cards(maplet).items():
        primary.header[key] = (value, comment)
    primary.header["DATASRC"] = (source, "SPO: images and lidar together")
    primary.header["MAP_VER"] = (f"{version:03d}", "product version number")
    primary.header["PRODNAME"] = (Path(path).name, "product filename")
    primary.header["TARGET"] = (provenance.body, "body")
    primary.header["SOFTWARE"] = ("spcola", "made by")
    primary.header["SOFT_VER"] = (provenance.versions.get("spcola", __version__), "its version")
    primary.header["PROVENAN"] = provenance.text()
    grid = maplet.grid
    frame = np.vstack([grid.center, grid.axes, maplet.center_sigma, np.full(3, grid.gsd)])
    exact = fits.ImageHDU(maplet.height.T.astype(">f8"), name="HEIGHT_M")
    exact.header["BUNIT"] = ("m", "the height plane, every bit kept")
    frame_unit = fits.ImageHDU(frame.astype(">f8"), name="FRAME")
    frame_unit.header["COMMENT"] = "rows: V (m), Ux, Uy, Uz, sigma of V (m), GSD (m) three times"
    with atomic.replacing(path) as temporary:
        fits.HDUList([primary, exact, frame_unit]).writeto(temporary, overwrite=True)


def read_fits_dtm(path: str | Path) -> Maplet:
    """Read an ALTWG FITS DTM; one with count and source planes becomes a fused maplet.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        If it is not FITS, has no cube, a plane or a keyword is missing or a value is impossible.
    """
    with reading_fits(path) as units:
        header = units[0].header
        cube = units[0].data
        extensions = {unit.name: np.array(unit.data, float) for unit in units[1:]}
        title = str(header.get("MAP_NAME", Path(path).stem))
        planes = {str(header[key]): int(key[5:]) - 1 for key in header if _is_plane(key)}
        cards = {key: header[key] for key in header if key and key != "COMMENT"}
    if cube is None or cube.ndim != 3 or cube.shape[1] != cube.shape[2] or cube.shape[1] % 2 == 0:
        raise FormatError("has no cube of square planes with an odd number of rows", path)
    lost = {"HEIGHT_M", "FRAME"} - set(extensions)
    if lost and cards.get("SOFTWARE") == "spcola":
        raise FormatError(f"is cut off: {', '.join(sorted(lost))} is missing", path)
    layers = _layers(np.asarray(cube, dtype=np.float64), planes, path)
    try:
        half_size = cube.shape[1] // 2
        grid, center_sigma = _frame(extensions.get("FRAME"), cards, half_size, path)
        if "HEIGHT_M" in extensions:
            layers["height"] = extensions["HEIGHT_M"].T
        else:
            # Other writers mark a missing point as maplets do: height and albedo both 0.
            missing = (layers["height"] == 0) & (layers["albedo"] == 0)
            layers["height"] = np.where(missing, np.nan, layers["height"])
        return maplet_of(title, grid, layers, center_sigma)
    except InvalidValueError as error:
        raise FormatError(str(error), path) from error


def _cube(maplet: Maplet) -> FloatArray:
    """Return the planes (P, rows along Ux, columns along Uy) in the file's units."""
    points = maplet.points()
    longitude, latitude = lon_lat_deg(points)
    layers = layers_of(maplet)
    nothing = np.full(maplet.grid.shape, np.nan)
    quality = quality_of(layers["source"]) if "source" in layers else nothing
    radius = np.linalg.norm(points, axis=-1)
    planes = [latitude, longitude, radius / KM, *np.moveaxis(points / KM, -1, 0)]
    planes += [maplet.height / KM, maplet.albedo, maplet.sigma, quality]
    planes += [layers[key] for key in ("count", "source") if key in layers]
    # Arrays on maplets run along Uy first, the planes of the file along Ux.
    return np.stack(planes).transpose(0, 2, 1).astype(np.float64)


def _cards(maplet: Maplet) -> dict[str, tuple[Any, str]]:
    """Return keyword → (value, comment) of the header cards on the maplet's place."""
    grid = maplet.grid
    longitude, latitude = lon_lat_deg(grid.center)
    sigma = maplet.sigma[np.isfinite(maplet.sigma)]
    cards: dict[str, tuple[Any, str]] = {
        "MAP_NAME": (maplet.name, "maplet or bigmap"),
        "MAP_TYPE": ("local", "global or local map"),
        "GSD": (grid.gsd * 1e3, "[mm] grid spacing"),
        "GSDI": (round(grid.gsd * 1e3), "[mm] grid spacing, whole"),
        "CLON": (float(longitude), "[deg] longitude at center"),
        "CLAT": (float(latitude), "[deg] latitude at center"),
    }
    # Upper is the first row (along Ux), left the first column (along Uy).
    corners = grid.points(np.nan_to_num(maplet.height))
    for key, (m, n) in {"LL": (0, -1), "UR": (-1, 0), "LR": (-1, -1), "UL": (0, 0)}.items():
        corner_lon, corner_lat = lon_lat_deg(corners[m, n])
        cards[f"{key}CLNG"] = (float(corner_lon), "[deg]")
        cards[f"{key}CLAT"] = (float(corner_lat), "[deg]")
    vectors = {"CNTR_V": grid.center / KM, "UX": grid.ux, "UY": grid.uy, "UZ": grid.uz}
    for key, vector in vectors.items():
        for letter, value in zip("XYZ", vector.tolist(), strict=True):
            cards[f"{key}_{letter}"] = (value, "[km]" if key == "CNTR_V" else "")
    if sigma.size:
        cards["SIGMA"] = (float(np.sqrt(np.mean(sigma**2))), "[m] root mean square of the sigmas")
        cards["SIG_DEF"] = ("height uncertainty", "what SIGMA is")
    return cards


def _layers(cube: FloatArray, planes: Mapping[str, int], path: str | Path) -> dict[str, AnyArray]:
    """Return the maplet's layers from the cube, indexed as on a maplet grid."""
    for name in _NEEDED:
        if not 0 <= planes.get(name, -1) < len(cube):
            raise FormatError(f"has no plane {name!r}", path)
    height, albedo, sigma = (cube[planes[name]].T for name in _NEEDED)
    with np.errstate(over="ignore"):
        # The maplet refuses infinite heights.
        layers: dict[str, AnyArray] = {"height": height * KM, "albedo": albedo, "sigma": sigma}
    for key, (name, _) in zip(("count", "source"), _FUSED_PLANES, strict=True):
        if 0 <= planes.get(name, -1) < len(cube):
            plane = cube[planes[name]].T
            if not (np.array_equal(plane, np.rint(plane)) and np.all(np.abs(plane) < _MOST)):
                raise FormatError(f"plane {name!r} holds a value that is no whole number", path)
            layers[key] = plane.astype(np.int64)
    return layers


def _frame(
    exact: FloatArray | None, cards: Mapping[str, Any], half_size: int, path: str | Path
) -> tuple[MapletGrid, FloatArray]:
    """Return grid and sigma of V: from the extension, or from the keywords of other writers."""
    if exact is not None:
        if exact.shape != (6, 3):
            raise FormatError(f"extension FRAME has shape {exact.shape}, (6, 3) is needed", path)
        return MapletGrid(exact[0], exact[1:4], float(exact[5, 0]), half_size), exact[4]
    keys = [f"{vector}_{letter}" for vector in ("CNTR_V", "UX", "UY", "UZ") for letter in "XYZ"]
    values = []
    for key in (*keys, "GSD"):
        try:
            values.append(float(cards[key]))
        except (KeyError, TypeError, ValueError) as error:
            raise FormatError("has no number", f"{path}: keyword {key}") from error
    vectors = np.array(values[:12]).reshape(4, 3)
    grid = MapletGrid(vectors[0] * KM, vectors[1:], values[12] / 1e3, half_size)
    return grid, np.full(3, np.nan)


def _is_plane(key: str) -> bool:
    """Return whether a keyword numbers a plane: PLANE1, PLANE2 and so on."""
    return key.startswith("PLANE") and key[5:].isdigit()
