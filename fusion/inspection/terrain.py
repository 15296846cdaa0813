"""The surface that a file holds: maplets, terrain models, shapes."""

from __future__ import annotations

from pathlib import Path

from fusion.inspection.file_kinds import FileKind, file_kind
from fusion.products.formats import is_surface, read_fits_dtm, read_geotiff, read_surface
from spcola.errors import FormatError
from spcola.formats.maplets import read_maplet
from spcola.formats.shapes import FacesFrom, Unit, read_icq, read_shape, recognise_shape
from spcola.grids import Maplet
from spcola.shape import Mesh
from spcola.shape.icq import IcqShape

_MAPLET_READERS = {
    FileKind.MAPLET: read_maplet,
    FileKind.FITS: read_fits_dtm,
    FileKind.GEOTIFF: read_geotiff,
}


def read_terrain(
    path: Path, *, unit: Unit = "km", faces_from: FacesFrom = 1
) -> Maplet | IcqShape | Mesh:
    """Read a maplet, a terrain model (FITS, GeoTIFF, OBJ or PLY of a release) or a shape.

    Parameters
    ----------
    path : Path
    unit : {"km", "m"}
        Of the coordinates of an OBJ or PLY that states none.
    faces_from : {1, 0}
        The number by which the faces of an OBJ name its first vertex.

    Raises
    ------
    FormatError
        If the file holds no surface, or is damaged.
    WorkspaceError
        If there is no such file.
    """
    kind = file_kind(path)
    if kind in _MAPLET_READERS:
        return _MAPLET_READERS[kind](path)
    if kind is not FileKind.SHAPE:
        article = "an" if kind[0] in "aeiou" else "a"
        raise FormatError(
            f"is {article} {kind}, no cloud and no surface",
            path,
            "give a lidar file, a cloud, a maplet, a terrain model or a shape",
        )
    if is_surface(path):
        return read_surface(path)
    if recognise_shape(path) == "icq":
        return read_icq(path)
    return read_shape(path, unit=unit, faces_from=faces_from)
