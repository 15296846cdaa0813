"""Gather the content of the report from a workspace."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from fusion.fusing.maplets import FUSED_HDF5, FusedMaplet, fused_names, read_fused
from fusion.pipeline.catalog import read_records
from fusion.products import versions
from fusion.registration.results import transform_of
from fusion.report.data import Coverage, Origins, ReportData, Surfaces
from fusion.report.recovered import Recovered, SurfaceErrors
from fusion.verdict import Verdict
from fusion.workspace import Workspace
from spcola.arrays import FloatArray
from spcola.errors import FormatError
from spcola.grids import project_maplet
from spcola.math import Affine

Row = TypeVar("Row", Recovered, SurfaceErrors)

PLANTED_FILE = "planted.json"
"""File in which a demo writes what it planted: a list under ``planted``, each entry with the
keys of :class:`~fusion.report.Recovered`, and one under ``errors`` with those of
:class:`~fusion.report.SurfaceErrors`; null for NaN."""

# Stages whose results are judged, in the order of the processing.
_JUDGED = ("register", "fuse", "scale")
# Places to show, and the points of the map of sources, come from this many maplets at most, evenly
# taken from all; from that many points at most.
_LOOKED_AT = 200
_MOST_POINTS = 400_000


def gather_report(workspace: Workspace, *, body: str, accepted: Sequence[str] = ()) -> ReportData:
    """Read what exists; what depends on a refused registration is left out.

    Parameters
    ----------
    workspace : Workspace
    body : str
        Name of the body.
    accepted : sequence of str
        Codes of findings that the user accepted.

    Raises
    ------
    SpcolaError
        If an existing file cannot be used.
    """
    registration = _optional_json(workspace, workspace.registration_path)
    scale = _optional_json(workspace, workspace.scale_path)
    refused = registration is not None and registration.get("verdict") == "refused"
    surfaces, origins = ((), None) if refused else _places(workspace)
    known = _optional_json(workspace, workspace.root / PLANTED_FILE) or {}
    return ReportData(
        body=body,
        surfaces=surfaces,
        coverage=gather_coverage(workspace),
        registration=registration,
        scale=scale,
        planted=_rows(known, "planted", Recovered),
        versions=versions(),
        verdicts=_verdicts(workspace),
        accepted=tuple(accepted),
        origins=origins,
        errors=_rows(known, "errors", SurfaceErrors),
    )


def _verdicts(workspace: Workspace) -> dict[str, Verdict]:
    """Verdicts of the stages that have one, as their last runs recorded them."""
    summaries = {record.stage: record.summary for record in read_records(workspace)}
    judged = (stage for stage in _JUDGED if "verdict" in summaries.get(stage, {}))
    return {stage: Verdict.from_json(summaries[stage]) for stage in judged}


def choose_places(surfaces: list[Surfaces]) -> list[Surfaces]:
    """Choose, each once, where one sees most of what each surface lacks.

    Where the lidar holds a part and SPC alone the rest; where most is in shadow; the largest
    difference; the largest lidar coverage. Shadow is where SPC has no height (or only a filled
    one) and the lidar has.
    """
    chosen: list[Surfaces] = []
    for why, worth in (
        ("a gap of the lidar, which only images see", _at_a_gap),
        ("most that only lidar sees", _only_lidar),
        ("largest difference of fused and SPC heights", _difference),
        ("largest lidar coverage", _covered),
    ):
        best = max(surfaces, key=worth, default=None)
        if best is None or worth(best) <= 0 or best.fused.name in {c.fused.name for c in chosen}:
            continue
        chosen.append(Surfaces(best.fused, best.spc, best.lidar, why))
    return chosen


def _at_a_gap(place: Surfaces) -> float:
    only_images = np.isfinite(place.spc) & ~np.isfinite(place.lidar)
    return min(float(np.mean(only_images)), _covered(place))


def _covered(place: Surfaces) -> float:
    return float(np.mean(np.isfinite(place.lidar)))


def _only_lidar(place: Surfaces) -> float:
    return float(np.mean(np.isfinite(place.lidar) & ~np.isfinite(place.spc)))


def _difference(place: Surfaces) -> float:
    gap = place.fused.height - place.spc
    known = gap[np.isfinite(gap)]
    return float(np.sqrt(np.mean(known**2))) if known.size else 0.0


def places_of(workspace: Workspace, *, most: int | None = None) -> Iterator[Surfaces]:
    """Yield three surfaces on one grid for all fused maplets, or for `most` evenly taken.

    Parameters
    ----------
    workspace : Workspace
    most : int, optional

    Raises
    ------
    SpcolaError
        If a file that is there cannot be used.
    """
    folder = workspace.root / "fused"
    if not (folder / FUSED_HDF5).is_file():
        return
    registration = _optional_json(workspace, workspace.registration_path)
    where = str(workspace.registration_path)
    transform = None if registration is None else transform_of(registration, where)
    names = fused_names(folder)
    step = 1 if most is None else max(1, len(names) // most)
    for name in names[::step]:
        yield _surfaces(workspace, read_fused(folder, name), transform)


def _places(workspace: Workspace) -> tuple[tuple[Surfaces, ...], Origins | None]:
    """Read candidates one after another; keep the best for each reason, and what all rest on."""
    kept: list[Surfaces] = []
    directions, sources = [], []
    for place in places_of(workspace, most=_LOOKED_AT):
        # Only the best so far are kept in memory.
        kept = choose_places([*kept, place])
        directions.append(place.fused.points()[place.fused.valid])
        sources.append(place.fused.source[place.fused.valid])
    if not directions:
        return (), None
    step = -(-sum(map(len, sources)) // _MOST_POINTS) or 1
    return tuple(kept), Origins(np.concatenate(directions)[::step], np.concatenate(sources)[::step])


def _surfaces(workspace: Workspace, fused: FusedMaplet, transform: Affine | None) -> Surfaces:
    """Bring the SPC maplet and the registered mapola of one name to the fused maplet's grid."""
    spc = lidar = np.full(fused.grid.shape, np.nan)
    if workspace.maplet_path(fused.name).is_file():
        spc = project_maplet(workspace.maplet(fused.name), fused.grid).height
    if transform is not None and fused.name in workspace.mapola_names():
        moved = workspace.mapola(fused.name).moved(transform)
        lidar = project_maplet(moved, fused.grid).height
    return Surfaces(fused, spc, lidar)


def gather_coverage(workspace: Workspace) -> Coverage | None:
    """Return the centres of maplets and mapolas, and the share of each that the lidar covers."""
    centers: dict[str, FloatArray] = {}
    share: dict[str, float] = {}
    for name in workspace.maplet_names():
        if workspace.maplet_path(name).is_file():
            centers[name], share[name] = workspace.maplet(name).grid.center, np.nan
    for name in workspace.mapola_names():
        mapola = workspace.mapola(name)
        centers.setdefault(name, mapola.grid.center)
        share[name] = mapola.coverage
    if not centers:
        return None
    return Coverage(np.stack(list(centers.values())), np.array([share[name] for name in centers]))


def _optional_json(workspace: Workspace, path: Path) -> dict[str, Any] | None:
    """Read a JSON artefact if it exists."""
    return workspace.read_json(path.name) if path.is_file() else None


def _rows(content: Mapping[str, Any], key: str, kind: type[Row]) -> tuple[Row, ...]:
    """Read the rows of one kind that a demo wrote; null is NaN."""
    try:
        return tuple(_row(entry, kind) for entry in content.get(key, ()))
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise FormatError(f"does not state what was planted ({error})", PLANTED_FILE) from error


def _row(entry: Mapping[str, Any], kind: type[Row]) -> Row:
    """Read one row: texts as they are, numbers and null as numbers."""
    values: dict[str, Any] = {
        field.name: entry[field.name] if field.default is MISSING else entry.get(field.name, "")
        for field in fields(kind)
    }
    for name, value in values.items():
        if not isinstance(value, str):
            values[name] = float("nan" if value is None else value)
    return kind(**values)
