"""A workspace at a glance: what it contains, and where on the body that lies."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from fusion.inspection import describe_workspace, outside_files
from fusion.pipeline.catalog import CATALOG_FILE, read_records
from fusion.runtime import content_digest, json_value
from fusion.runtime.folders import Remembered
from fusion.service.views.surfaces import SurfaceKind, surface_names
from fusion.stages.ingest import readable_scans
from fusion.workspace import Workspace, visible_files
from lidar.scan_store import ScanStore
from spcola.arrays import FloatArray
from spcola.errors import InvalidValueError
from spcola.formats.maplets import MapParts
from spcola.math import lon_lat_deg

# Returns that are counted, and images whose places are read.
_RETURNS, _IMAGES = 300_000, 2000
_USUAL_STEP = 5.0
_RESULTS = {
    "registration": ("model", "scale", "scale_sigma", "n_used", "n_rejected", "verdict"),
    "scale": ("epsilon", "epsilon_sigma", "size_correction_m", "size_correction_sigma_m", "n_used",
              "n_rejected", "verdict"),
}  # fmt: skip


def overview(workspace: Workspace) -> dict[str, Any]:
    """Return what ``spcola info`` finds, verdicts of stages, and the main results.

    It is remembered as long as no file of the workspace changes: see :class:`Remembered`.

    Parameters
    ----------
    workspace : Workspace

    Raises
    ------
    SpcolaError
        If its settings are wrong, or a folder of it cannot be read.
    """
    return _remembered(workspace, "overview", lambda: _overview(workspace))


def _overview(workspace: Workspace) -> dict[str, Any]:
    records = read_records(workspace)
    paths = {"registration": workspace.registration_path, "scale": workspace.scale_path}
    found = {name: workspace.find_json(path.name) for name, path in paths.items()}
    return {
        "name": workspace.root.resolve().name,
        **describe_workspace(workspace),
        "bigmaps": len({name.rpartition(":")[0] for name in _names(workspace, "bigmap")}),
        "pairs": len({name.rpartition(":")[0] for name in _names(workspace, "pair")}),
        "released": len(_names(workspace, "dtm")),
        "verdicts": {one.stage: one.summary["verdict"] for one in records if _judged(one.summary)},
        "findings": [
            {"stage": one.stage, **finding}
            for one in records
            for finding in one.summary.get("findings") or []
        ],
        "results": {
            name: None if content is None else {key: content.get(key) for key in _RESULTS[name]}
            for name, content in found.items()
        },
    }


def workspace_etag(workspace: Workspace) -> str:
    """Return a text that changes with any visible file of a workspace: the tag of its views.

    A third of a second for 100,000 files.
    """
    return content_digest([Remembered(workspace.root).listing().files, workspace.solution])[:32]


def coverage(workspace: Workspace, *, step_deg: float = _USUAL_STEP) -> dict[str, Any]:
    """Return where maplets, mapolas, fused maplets, bigmaps, images and returns lie.

    Parameters
    ----------
    workspace : Workspace
    step_deg : float
        Side of the cells in which returns are counted; it divides 180°.

    Returns
    -------
    dict
        Of surfaces the columns `name`, `longitude_deg`, `latitude_deg`, `radius_m`, `side_m` and
        `gsd_m`; of images the points below the spacecraft, evenly chosen if there are over 2000;
        of returns `density_per_m2` (rows from the south, columns from 0° east), from an even
        choice of `counted` among all `returns`. Mapolas and returns are in the frame of the lidar.

    Raises
    ------
    InvalidValueError
        If the step does not divide 180°, or is below 0.25°.
    SpcolaError
        If a file is damaged.
    """
    rows = round(180.0 / step_deg) if step_deg >= 0.25 else 0
    if rows < 1 or abs(rows * step_deg - 180.0) > 1e-9:
        raise InvalidValueError(f"{step_deg}° does not divide 180°, or is below 0.25°", "step_deg")
    if step_deg != _USUAL_STEP:
        return _coverage(workspace, rows)
    return _remembered(workspace, "coverage", lambda: _coverage(workspace, rows))


def _coverage(workspace: Workspace, rows: int) -> dict[str, Any]:
    maplets = (workspace.maplet_path(name) for name in _names(workspace, "maplet"))
    return {
        "maplets": _footprints(maplets),
        "mapolas": _footprints(visible_files(workspace.home / "mapolas", ".MAP")),
        "fused": _footprints(visible_files(workspace.home / "fused", ".MAP")),
        "bigmaps": _footprints(visible_files(workspace.home / "bigmaps", ".MAP")),
        "images": _image_places(workspace),
        "returns": _returns(workspace, rows),
    }


def density_of(points: FloatArray, total: int, rows: int) -> FloatArray:
    """Return the density (rows, 2 rows), 1/m², of `total` points of which some are given.

    Parameters
    ----------
    points : (N, 3) ndarray
        An even choice, metres.
    total : int
    rows : int
        Cells from the south pole to the north pole. A cell is a part of the sphere of the mean
        radius of its points.
    """
    longitude, latitude = lon_lat_deg(points)
    row = np.clip((latitude + 90.0) * rows / 180.0, 0, rows - 1).astype(np.int64)
    column = np.clip(longitude * rows / 180.0, 0, 2 * rows - 1).astype(np.int64)
    cell, shape = row * 2 * rows + column, (rows, 2 * rows)
    count = np.bincount(cell, minlength=2 * rows * rows).reshape(shape)
    radii = np.bincount(cell, np.linalg.norm(points, axis=1), 2 * rows * rows).reshape(shape)
    edges = np.sin(np.linspace(-np.pi / 2.0, np.pi / 2.0, rows + 1))
    steradians = np.pi / rows * np.diff(edges)[:, None]
    # An empty cell has density 0 whatever its area.
    area = np.where(count > 0, radii / np.maximum(count, 1), 1.0) ** 2 * steradians
    density: FloatArray = count * (total / max(len(points), 1)) / area
    return density


def _remembered(
    workspace: Workspace, what: str, make: Callable[[], dict[str, Any]]
) -> dict[str, Any]:
    """Return what `make` finds out, in JSON types, made again after a file has changed."""
    kept = Remembered(workspace.root, f"{what}-{workspace.solution}")
    before = kept.listing()
    found = kept.find(before)
    if found is None:
        # A stage notes its end in the catalogue, which may be after its files are written.
        catalogs = sorted({workspace.home / CATALOG_FILE, workspace.root / CATALOG_FILE})
        noted = _states(catalogs)
        outside = [*outside_files(workspace, workspace.settings()), *catalogs]
        found = json_value(make())
        if noted == _states(catalogs):
            kept.keep(before, found, outside)
    return dict(found)


def _states(paths: Iterable[Path]) -> list[int]:
    return [path.stat().st_mtime_ns if path.is_file() else 0 for path in paths]


def _judged(summary: Any) -> bool:
    return summary.get("verdict") is not None


def _names(workspace: Workspace, kind: str) -> list[str]:
    return surface_names(workspace, SurfaceKind(kind))


def _footprints(paths: Iterable[Path]) -> dict[str, Any]:
    """Return the columns of places and sizes of .MAP files."""
    known = [(path.stem, MapParts.open(path).grid) for path in paths]
    centers = np.array([grid.center for _, grid in known]).reshape(-1, 3)
    longitude, latitude = lon_lat_deg(centers)
    return {
        "name": [name for name, _ in known],
        "longitude_deg": longitude,
        "latitude_deg": latitude,
        "radius_m": np.linalg.norm(centers, axis=1),
        "side_m": [(grid.size - 1) * grid.gsd for _, grid in known],
        "gsd_m": [grid.gsd for _, grid in known],
    }


def _image_places(workspace: Workspace) -> dict[str, Any]:
    """Return the columns of points below the spacecraft."""
    names = workspace.image_names()
    chosen = names[:: max(1, -(-len(names) // _IMAGES))]
    places = np.array([workspace.image(name).position for name in chosen]).reshape(-1, 3)
    longitude, latitude = lon_lat_deg(places)
    return {
        "name": chosen,
        "longitude_deg": longitude,
        "latitude_deg": latitude,
        "distance_m": np.linalg.norm(places, axis=1),
        "all": len(names),
    }


def _returns(workspace: Workspace, rows: int) -> dict[str, Any]:
    """Return the density of the returns of all sound scans."""
    scans = readable_scans(workspace)
    total = sum(scan.count for scan in scans.values())
    points: FloatArray = np.empty((0, 3))
    if total:
        points = ScanStore([workspace.scan_path(name) for name in scans]).spread(_RETURNS)
    return {
        "step_deg": 180.0 / rows,
        "returns": total,
        "counted": len(points),
        "density_per_m2": density_of(points, total, rows),
    }
