"""A file of any kind as points of its surface: clouds, scans, maplets, terrain models, shapes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from fusion.inspection.file_kinds import FileKind, file_kind, lidar_format
from fusion.inspection.terrain import read_terrain
from lidar.formats import read_sample
from lidar.formats.records import LidarOptions
from spcola.arrays import FloatArray
from spcola.formats.shapes import Unit
from spcola.grids import Maplet
from spcola.shape import Mesh, sample_surface
from spcola.shape.icq import IcqShape

MOST_POINTS = 2_000_000
"""Points of a file that are used at most, evenly chosen among all."""

# Most samples across a typical edge of a facet.
_ACROSS = 6


@dataclass(frozen=True, eq=False)
class PointSource:
    """Points of the surface that a file holds.

    Attributes
    ----------
    path : Path
    kind : {"cloud", "mesh", "shape (ICQ)", "maplet"}
    points : (N, 3) ndarray
        Metres.
    count : int
        Points of the file, of which `points` may be a part, or vertices of a mesh.
    left_out : mapping of str to int
        Records of the file without a place, by reason.
    unit : {"km", "m"}
        Of the coordinates in the file.
    resolution_m : float
        Distance of the points of a maplet (its GSD) or a mesh, metres; 0 for a cloud.
    surface : Mesh, IcqShape or Maplet, optional
        What the points were taken from; None for a cloud, which is read again to be moved.
    """

    path: Path
    kind: Literal["cloud", "mesh", "shape (ICQ)", "maplet"]
    points: FloatArray
    count: int
    left_out: Mapping[str, int] = field(default_factory=dict)
    unit: Unit = "km"
    resolution_m: float = 0.0
    surface: Mesh | IcqShape | Maplet | None = None


def read_points(path: Path, *, unit: Unit | None = None) -> PointSource:
    """Read a lidar file or scan, a cloud, a maplet, a terrain model or a shape as points.

    Parameters
    ----------
    path : Path
    unit : {"km", "m"}, optional
        Of the coordinates of a file that states none: shapes in OBJ and PLY are in km if not given,
        clouds in metres.

    Raises
    ------
    FormatError
        If the file cannot be read, or is of a kind that holds no surface.
    """
    if file_kind(path) is FileKind.LIDAR:
        return _cloud(path, unit)
    surface = read_terrain(path, unit=unit or "km")
    if isinstance(surface, Maplet):
        return _maplet(path, surface)
    return _shape(path, surface, unit or "km")


def _cloud(path: Path, unit: Unit | None) -> PointSource:
    options = LidarOptions(unit=unit)
    sample = read_sample(path, MOST_POINTS, format=lidar_format(path), options=options)
    points = np.ascontiguousarray(sample.scan.points)
    return PointSource(path, "cloud", points, sample.count, sample.rejected, unit or "m")


def _maplet(path: Path, maplet: Maplet) -> PointSource:
    points = np.ascontiguousarray(maplet.points()[maplet.valid])
    lost = maplet.height.size - len(points)
    left = {"without a height": lost} if lost else {}
    return PointSource(path, "maplet", points, len(points), left, "km", maplet.grid.gsd, maplet)


def _shape(path: Path, surface: Mesh | IcqShape, unit: Unit) -> PointSource:
    """Sample a shape evenly over its facets: its vertices alone crowd where facets are small."""
    icq = isinstance(surface, IcqShape)
    mesh = surface.mesh() if isinstance(surface, IcqShape) else surface
    area = float(np.sum(np.linalg.norm(mesh.area_vectors, axis=1)))
    edge = float(np.sqrt(2.0 * area / max(len(mesh.facets), 1)))
    across = np.floor(np.sqrt(MOST_POINTS / max(len(mesh.facets), 1)))
    step = edge / float(np.clip(across, 1, _ACROSS))
    points = sample_surface(mesh, step).points
    points = np.ascontiguousarray(points[:: -(-len(points) // MOST_POINTS)])
    return PointSource(
        path,
        "shape (ICQ)" if icq else "mesh",
        points,
        len(mesh.vertices),
        unit="km" if icq else unit,
        resolution_m=step,
        surface=surface,
    )
