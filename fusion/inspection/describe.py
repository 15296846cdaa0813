"""Content of a file, for ``spcola info``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from fusion.inspection.file_kinds import FileKind, file_kind, first_word, lidar_format, summary_path
from fusion.inspection.image_facts import image_facts
from fusion.inspection.import_forecast import ImportClock
from fusion.products.formats import read_fits_dtm, read_geotiff
from fusion.stages.ingest import scan_facts, span_facts
from fusion.workspace import Workspace
from fusion.workspace.settings import load_settings
from lidar.formats import open_lidar
from lidar.formats.clouds import read_las_system
from lidar.formats.native import scan_summary
from spcola.formats.maplets import read_map, read_maplet
from spcola.formats.shapes import FacesFrom, read_icq, read_shape, recognise_shape
from spcola.formats.solution import read_landmark, read_list, read_nominal, read_summary
from spcola.formats.solution.line_scan import read_line_scan
from spcola.grids import Maplet
from spcola.navigation import utc_from_et
from spcola.shape.icq import IcqShape, as_icq
from spcola.spice import orientation_of, read_transfer


def describe_file(path: Path, *, faces_from: FacesFrom = 1) -> dict[str, Any]:
    """Return the facts of a file of any kind that is read (:func:`file_kind`).

    Parameters
    ----------
    path : Path
    faces_from : {1, 0}
        Number of the first vertex in the faces of an OBJ.

    Raises
    ------
    FormatError
        If it is in no known format, with what it is instead, or is damaged.
    WorkspaceError
        If there is no such file.
    """
    kind = file_kind(path)
    if kind is FileKind.SHAPE:
        return _describe_shape(path, faces_from)
    return _READERS[kind](path)


def _describe_kernel(path: Path) -> dict[str, Any]:
    word, _ = first_word(path)
    if word == "DAFETF":
        return {"kind": "SPICE kernel (transfer text)", "form": read_transfer(path).word.strip()}
    if word.startswith("DAF/"):
        return {"kind": "SPICE kernel (binary)", "form": word[:8].rstrip("\0")}
    stated = orientation_of(path)
    meridians = {body: stated.get(body, "PM") for body in stated.bodies}
    beyond = {str(body): list(stated.beyond_spin(body)) for body in stated.bodies}
    return {
        "kind": "SPICE kernel (text)",
        "form": word if word.startswith("KPL/") else "not stated",
        "prime_meridian_deg": {str(body): w[0] for body, w in meridians.items() if w},
        "terms_that_spin_lacks": {body: names for body, names in beyond.items() if names},
    }


def _describe_map(path: Path) -> dict[str, Any]:
    header = read_map(path).header
    return {"kind": "maplet", **maplet_facts(read_maplet(path)), "version": header.version}


def maplet_facts(maplet: Maplet) -> dict[str, Any]:
    """Return name, grid, place and range of heights of a maplet, in JSON types."""
    center = maplet.grid.center
    radius = float(np.linalg.norm(center))
    known = maplet.height[maplet.valid]
    return {
        "name": maplet.name,
        "half_size": maplet.grid.half_size,
        "gsd_m": maplet.grid.gsd,
        "center_m": center.tolist(),
        "radius_m": radius,
        "latitude_deg": float(np.degrees(np.arcsin(center[2] / radius))) if radius else None,
        "longitude_deg": float(np.degrees(np.arctan2(center[1], center[0])) % 360.0),
        "missing": int(np.count_nonzero(~maplet.valid)),
        "lowest_m": float(known.min()) if known.size else None,
        "highest_m": float(known.max()) if known.size else None,
        "has_sigma": bool(np.isfinite(maplet.sigma).any()),
    }


def _describe_landmark(path: Path) -> dict[str, Any]:
    landmark = read_landmark(path)
    return {
        "kind": "landmark",
        "name": landmark.name,
        "center_m": landmark.grid.center.tolist(),
        "sigma_m": landmark.sigma.tolist(),
        "gsd_m": landmark.grid.gsd,
        "half_size": landmark.grid.half_size,
        "pictures": len(landmark.pictures),
        "overlaps": len(landmark.overlaps),
        "limbs": len(landmark.limbs),
    }


def _describe_summary(path: Path) -> dict[str, Any]:
    image = read_summary(path)
    return {
        "kind": "image summary",
        "name": image.name,
        "utc": image.utc,
        "pixels": image.camera.width,
        "lines": image.camera.height,
        "focal_length_mm": image.camera.focal_length_mm,
        "distortion_model": image.camera.distortion_model,
        "distance_m": float(np.linalg.norm(image.position)),
        "landmarks": len(image.landmarks),
        "limbs": len(image.limbs),
    }


def _describe_line_scan(path: Path) -> dict[str, Any]:
    image = read_line_scan(path)
    scan = image.scan
    return {
        "kind": "line-scan image",
        "name": image.name,
        "first_line_utc": utc_from_et(float(scan.times[0]), 6),
        "last_line_utc": utc_from_et(float(scan.times[-1]), 6),
        "pixels": scan.camera.width,
        "lines": scan.height,
        "focal_length_mm": scan.camera.focal_length_mm,
        "distortion_model": scan.camera.distortion_model,
        "distance_m": float(np.linalg.norm(scan.positions[scan.height // 2])),
    }


def _describe_shape(path: Path, faces_from: FacesFrom) -> dict[str, Any]:
    form = recognise_shape(path)
    shape = read_icq(path) if form == "icq" else None
    mesh = shape.mesh() if shape else read_shape(path, faces_from=faces_from)
    # Some programs write an ICQ as an OBJ, with all labels in order.
    labels = shape or as_icq(mesh)
    return {
        "kind": f"shape ({form}, taken as km)",
        **({} if labels is None else _icq_facts(labels)),
        "vertices": len(mesh.vertices),
        "facets": len(mesh.facets),
        "volume_m3": mesh.volume,
        "mean_radius_m": mesh.mean_radius,
        "lowest_m": mesh.vertices.min(axis=0).tolist(),
        "highest_m": mesh.vertices.max(axis=0).tolist(),
    }


def _icq_facts(shape: IcqShape) -> dict[str, Any]:
    """Return Q of an ICQ shape, and the differences between labels of one vertex."""
    gaps = shape.gaps
    return {
        "icq_q": shape.q,
        "icq_labels_shared": gaps.shared,
        "icq_labels_differing": gaps.differing,
        "icq_differ_max_m": gaps.max_m,
        "icq_differ_rms_m": gaps.rms_m,
    }


def _describe_image(path: Path) -> dict[str, Any]:
    """Describe an image by its .SUM file, and one without by its label."""
    summary = summary_path(path)
    if summary is not None:
        return {**_describe_summary(summary), "kind": "image", "summary": str(summary)}
    return image_facts(path)


def _describe_lidar(path: Path) -> dict[str, Any]:
    """Describe a lidar file; all of it is read, a chunk at a time."""
    format = lidar_format(path)
    if format == "native":
        return {"kind": "lidar (native)", **scan_facts(scan_summary(path))}
    count, rejected = 0, dict[str, int]()
    lowest, highest = np.full(3, np.nan), np.full(3, np.nan)
    span = np.array([np.nan, np.nan])
    clock = ImportClock()
    for scan in clock.timed(open_lidar(path, format=format)):
        count += len(scan)
        for reason, number in scan.rejected.items():
            rejected[reason] = rejected.get(reason, 0) + number
        if len(scan):
            lowest = np.fmin(lowest, scan.points.min(axis=0))
            highest = np.fmax(highest, scan.points.max(axis=0))
            span[0] = np.fmin(span[0], np.fmin.reduce(scan.time))
            span[1] = np.fmax(span[1], np.fmax.reduce(scan.time))
    return {
        "kind": f"lidar ({format})",
        **(_las_facts(path) if format == "las" else {}),
        "returns": count,
        "rejected": rejected,
        **span_facts(span),
        "lowest_m": lowest.tolist(),
        "highest_m": highest.tolist(),
        **clock.forecast(path),
    }


def _las_facts(path: Path) -> dict[str, Any]:
    """Return the coordinate system of a LAS file."""
    system = read_las_system(path)
    return {
        "coordinate_system": system.name or system.kind,
        "coordinate_kind": system.kind,
        "unit_m": system.unit_m,
        "height_unit_m": system.height_unit_m,
    }


_READERS: dict[FileKind, Callable[[Path], dict[str, Any]]] = {
    FileKind.MAPLET: _describe_map,
    FileKind.LANDMARK: _describe_landmark,
    FileKind.SUMMARY: _describe_summary,
    FileKind.IMAGE: _describe_image,
    FileKind.LINE_SCAN: _describe_line_scan,
    FileKind.NOMINAL: lambda path: {"kind": "nominal state", "name": read_nominal(path).name},
    FileKind.LIST: lambda path: {"kind": "list", "names": len(read_list(path))},
    FileKind.SETTINGS: lambda path: {
        "kind": "settings",
        **load_settings(path).model_dump(by_alias=True),
    },
    FileKind.JSON: lambda path: {"kind": "JSON", **Workspace(path.parent).read_json(path.name)},
    FileKind.FITS: lambda path: {"kind": FileKind.FITS, **maplet_facts(read_fits_dtm(path))},
    FileKind.GEOTIFF: lambda path: {"kind": FileKind.GEOTIFF, **maplet_facts(read_geotiff(path))},
    FileKind.KERNEL: _describe_kernel,
    FileKind.LIDAR: _describe_lidar,
}
