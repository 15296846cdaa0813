"""Which picture shows a file: one function for each kind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fusion.inspection.file_kinds import FileKind, file_kind
from fusion.inspection.look.images import image_picture
from fusion.inspection.look.maplets import look_at_map, maplet_picture, read_surface_file
from fusion.inspection.look.overview import workspace_picture
from fusion.inspection.look.picture import Picture
from fusion.inspection.look.results import result_picture
from fusion.inspection.look.scans import scan_picture
from fusion.inspection.look.shapes import shape_picture
from fusion.products.formats import is_surface, read_fits_dtm, read_geotiff, read_surface
from fusion.workspace import SETTINGS_FILE, Workspace
from fusion.workspace.settings import load_settings
from spcola.errors import FormatError
from spcola.formats.shapes import FacesFrom, Unit, read_shape, recognise_shape


@dataclass(frozen=True)
class LookOptions:
    """What a file does not state about its own coordinates.

    Parameters
    ----------
    unit : {"km", "m"}, optional
        Of the coordinates of an OBJ or PLY shape; km if not given, or as in the settings of the
        workspace in which it lies.
    faces_from : {1, 0}, optional
        The number by which the faces of an OBJ name its first vertex.
    """

    unit: Unit | None = None
    faces_from: FacesFrom | None = None


def look_at(path: str | Path, options: LookOptions | None = None) -> Picture:
    """Draw what a file or a workspace holds.

    Parameters
    ----------
    path : str or Path
        A workspace, or a file of any kind that is read: maplet, bigmap, mapola, fused maplet or
        pair (.MAP), image (.SUM, .DAT, FITS), landmark, shape, lidar file or scan, terrain model
        (FITS, GeoTIFF, OBJ, PLY), registration.json or scale.json.
    options : LookOptions, optional

    Returns
    -------
    Picture
        A notebook shows it; ``picture.figure`` is the Matplotlib figure.

    Raises
    ------
    FormatError
        If the file cannot be read, or there is nothing to draw in it.
    WorkspaceError
        If there is no such file, or a folder is no workspace.

    Examples
    --------
    >>> import fusion
    >>> picture = fusion.look_at("bennu/MAPFILES/AB0001.MAP")  # doctest: +SKIP
    >>> picture.figure.savefig("AB0001.png")  # doctest: +SKIP
    """
    path = Path(path)
    if path.is_dir():
        return workspace_picture(Workspace.open(path))
    kind = file_kind(path)
    if kind is FileKind.SHAPE:
        return _shape(path, options or LookOptions())
    draw = _DRAWN.get(kind)
    if draw is None:
        article = "an" if kind[0] in "aeiou" else "a"
        words = {FileKind.SETTINGS: "are settings", FileKind.LIST: "is a list of names"}
        what = words.get(kind, f"is {article} {kind}")
        raise FormatError(f"{what}: there is nothing to draw", path, f"see: spcola info {path}")
    return draw(path)


def _shape(path: Path, options: LookOptions) -> Picture:
    """Draw a shape, or the maplet that a product in OBJ or PLY is."""
    if is_surface(path):
        return maplet_picture(read_surface(path))
    unit, faces_from = options.unit, options.faces_from
    settings = path.absolute().parent.parent / SETTINGS_FILE
    if path.absolute().parent.name == "SHAPEFILES" and settings.is_file():
        body = load_settings(settings).body
        unit, faces_from = unit or body.shape_unit, faces_from or body.faces_from
    chosen: FacesFrom = 1 if faces_from is None else faces_from
    mesh = read_shape(path, unit=unit or "km", faces_from=chosen)
    form = recognise_shape(path)
    stated = "ICQ" if form == "icq" else f"{form.upper()}, taken as {unit or 'km'}"
    return shape_picture(mesh, name=path.name, form=stated)


def _landmark(path: Path) -> Picture:
    """Draw the maplet of a landmark."""
    maplet = path.absolute().parent.parent / "MAPFILES" / f"{path.stem}.MAP"
    if not maplet.is_file():
        raise FormatError(
            f"is a landmark, and its maplet {maplet.name} is not in MAPFILES next to its folder",
            path,
            f"there is nothing to draw; see: spcola info {path}",
        )
    return maplet_picture(read_surface_file(maplet))


_DRAWN: dict[FileKind, Callable[[Path], Picture]] = {
    FileKind.MAPLET: look_at_map,
    FileKind.LANDMARK: _landmark,
    FileKind.SUMMARY: image_picture,
    FileKind.IMAGE: image_picture,
    FileKind.JSON: result_picture,
    FileKind.FITS: lambda path: maplet_picture(read_fits_dtm(path)),
    FileKind.GEOTIFF: lambda path: maplet_picture(read_geotiff(path)),
    FileKind.LIDAR: scan_picture,
}
