"""The moving file of an alignment, moved onto the fixed one and written in its own format."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from fusion.inspection.file_kinds import lidar_format
from fusion.inspection.points.sources import PointSource
from lidar.formats import open_lidar, read_scan
from lidar.formats.clouds import write_las
from lidar.formats.native import write_scan
from lidar.formats.records import LidarOptions
from lidar.scans import Scan
from spcola.errors import InvalidValueError, WorkspaceError
from spcola.formats.maplets import write_maplet
from spcola.formats.shapes import write_icq, write_obj_mesh
from spcola.formats.shapes.ply import write_ply_mesh
from spcola.grids import Maplet
from spcola.math import Affine
from spcola.shape import Mesh
from spcola.shape.icq import IcqShape

_WRITTEN = {
    "cloud": (".ply", ".las", ".laz", ".h5"),
    "mesh": (".obj", ".ply"),
    "shape (ICQ)": (".txt", ".obj", ".ply"),
    "maplet": (".map",),
}
# Decimals of an ICQ: a hundredth of what SPC itself writes would round off.
_DIGITS = 7
# Departure from a similarity below which a matrix is one.
_ROUNDING = 1e-9


def check_target(source: PointSource, target: Path) -> None:
    """Refuse a file that the moved source cannot be written to, before anything is computed.

    Parameters
    ----------
    source : PointSource
    target : Path

    Raises
    ------
    WorkspaceError
        If its suffix is of a format that does not hold what the source is, or it is the source.
    """
    known = _WRITTEN[source.kind]
    if target.suffix.lower() not in known:
        raise WorkspaceError(
            f"a {source.kind} can be written as {', '.join(known)}", target, "end the name so"
        )
    if target.exists() and target.samefile(source.path):
        raise WorkspaceError("is the moving file itself", target, "write to another one")


def write_moved(source: PointSource, transform: Affine, target: Path) -> None:
    """Write a file's surface, moved by a transform; the suffix of `target` chooses the format.

    Clouds become PLY (metres, with intensity), LAS, LAZ or a native scan (.h5): all returns, not
    only those that were used. Meshes become OBJ or PLY in the unit of the source, an ICQ an ICQ
    too, maplets .MAP.

    Parameters
    ----------
    source : PointSource
    transform : Affine
        From the coordinates of the source, metres.
    target : Path

    Raises
    ------
    InvalidValueError
        If a maplet is to be moved by an affine map: its grid would not be square any more.
    WorkspaceError
        If the file cannot be written.
    """
    surface = source.surface
    if surface is None:
        _write_cloud(source, transform, target)
    elif isinstance(surface, Maplet):
        write_maplet(target, moved_maplet(surface, transform))
    elif isinstance(surface, IcqShape) and target.suffix.lower() == ".txt":
        moved = replace(surface, vertices=transform.apply(surface.vertices))
        write_icq(target, moved, digits=_DIGITS)
    else:
        mesh = surface.mesh() if isinstance(surface, IcqShape) else surface
        _write_mesh(replace(mesh, vertices=transform.apply(mesh.vertices)), source, target)


def moved_maplet(maplet: Maplet, transform: Affine) -> Maplet:
    """Return a maplet moved by a similarity: its GSD and heights are scaled too.

    Raises
    ------
    InvalidValueError
        If the transform is no similarity.
    """
    similarity = transform.nearest_similarity()
    apart = np.abs(transform.matrix - similarity.scale * similarity.rotation).max()
    if apart > _ROUNDING * similarity.scale:
        raise InvalidValueError(
            "cannot be moved by an affine map: its grid would not be square any more",
            maplet.name,
            "align with --model similarity or rigid",
        )
    moved = maplet.grid.moved(similarity)
    grid = replace(moved, gsd=moved.gsd * similarity.scale)
    height, sigma = (similarity.scale * layer for layer in (maplet.height, maplet.sigma))
    return replace(maplet, grid=grid, height=height, sigma=sigma)


def moved_scan(scan: Scan, transform: Affine) -> Scan:
    """Return a scan with returns and spacecraft moved, ranges and sigmas as long as they become."""
    along = transform.turn(scan.beam)
    longer = np.linalg.norm(along, axis=1)
    unknown = np.isnan(longer)
    longer[unknown] = transform.nearest_similarity().scale
    with np.errstate(invalid="ignore"):
        beam = along / longer[:, None]
    return scan.with_points(
        transform.apply(scan.points),
        spacecraft=transform.apply(scan.spacecraft),
        beam=beam,
        range=scan.range * longer,
        sigma=scan.sigma * longer,
    )


def _write_mesh(mesh: Mesh, source: PointSource, target: Path) -> None:
    if target.suffix.lower() == ".obj":
        write_obj_mesh(target, mesh, unit=source.unit)
    else:
        write_ply_mesh(target, mesh, unit=source.unit)


def _write_cloud(source: PointSource, transform: Affine, target: Path) -> None:
    """Write all returns of a cloud."""
    options = LidarOptions(unit=source.unit if source.unit != "m" else None)
    format, suffix = lidar_format(source.path), target.suffix.lower()

    def chunks() -> Iterator[Scan]:
        for chunk in open_lidar(source.path, format=format, options=options):
            yield moved_scan(chunk, transform)

    if suffix == ".h5":
        write_scan(target, chunks())
    elif suffix in (".las", ".laz"):
        write_las(target, chunks(), compressed=suffix == ".laz")
    else:
        scan = moved_scan(read_scan(source.path, format=format, options=options), transform)
        layers = {"intensity": scan.intensity} if np.isfinite(scan.intensity).any() else {}
        mesh = Mesh(scan.points, np.empty((0, 3), dtype=np.int64), scan.name)
        write_ply_mesh(target, mesh, unit="m", layers=layers)
