"""Gather the content of the report from a workspace."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fusion.estimation.verdict import Verdict
from fusion.fusing.maplets import FUSED_HDF5, FusedMaplet, fused_names, read_fused
from fusion.pipeline.catalog import read_records
from fusion.products import versions
from fusion.registration.results import transform_of
from fusion.report.data import Coverage, ReportData, Surfaces
from fusion.report.recovered import Recovered
from fusion.workspace import Workspace
from spcola.arrays import FloatArray
from spcola.errors import FormatError
from spcola.grids import project_maplet
from spcola.math import Affine

PLANTED_FILE = "planted.json"
"""File in which a demo writes what it planted: a list under ``planted``, each entry with the
keys of :class:`~fusion.truth.recovery.Recovered`, null for NaN."""

# Stages whose results are judged, in the order of the processing.
_JUDGED = ("register", "fuse", "scale")
# Places to show are chosen from at most this many maplets, evenly taken from all.
_LOOKED_AT = 200


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
    return ReportData(
        body=body,
        surfaces=() if refused else _places(workspace, registration),
        coverage=_coverage(workspace),
        registration=registration,
        scale=scale,
        planted=_planted(workspace),
        versions=versions(),
        verdicts=_verdicts(workspace),
        accepted=tuple(accepted),
    )


def _verdicts(workspace: Workspace) -> dict[str, Verdict]:
    """Verdicts of the stages that have one, as their last runs recorded them."""
    summaries = {record.stage: record.summary for record in read_records(workspace)}
    judged = (stage for stage in _JUDGED if "verdict" in summaries.get(stage, {}))
    return {stage: Verdict.from_json(summaries[stage]) for stage in judged}


def choose_places(surfaces: list[Surfaces]) -> list[Surfaces]:
    """Choose, each once: the largest lidar coverage, the most shadow, the largest difference.

    Shadow is where SPC has no height (or only a filled one) and the lidar has.
    """
    chosen: list[Surfaces] = []
    for why, worth in (
        ("largest lidar coverage", _covered),
        ("most points that only the lidar covers", _only_lidar),
        ("largest difference of fused and SPC heights", _difference),
    ):
        best = max(surfaces, key=worth, default=None)
        if best is None or worth(best) <= 0 or best.fused.name in {c.fused.name for c in chosen}:
            continue
        chosen.append(Surfaces(best.fused, best.spc, best.lidar, why))
    return chosen


def _covered(place: Surfaces) -> float:
    return float(np.mean(np.isfinite(place.lidar)))


def _only_lidar(place: Surfaces) -> float:
    return float(np.mean(np.isfinite(place.lidar) & ~np.isfinite(place.spc)))


def _difference(place: Surfaces) -> float:
    gap = place.fused.height - place.spc
    known = gap[np.isfinite(gap)]
    return float(np.sqrt(np.mean(known**2))) if known.size else 0.0


def _places(workspace: Workspace, registration: dict[str, Any] | None) -> tuple[Surfaces, ...]:
    """Read the candidates one by one and keep the best for each reason."""
    folder = workspace.root / "fused"
    if not (folder / FUSED_HDF5).is_file():
        return ()
    names = fused_names(folder)
    where = str(workspace.registration_path)
    transform = None if registration is None else transform_of(registration, where)
    kept: list[Surfaces] = []
    for name in names[:: max(1, len(names) // _LOOKED_AT)]:
        # Only the best so far are kept in memory.
        kept = choose_places([*kept, _surfaces(workspace, read_fused(folder, name), transform)])
    return tuple(kept)


def _surfaces(workspace: Workspace, fused: FusedMaplet, transform: Affine | None) -> Surfaces:
    """Bring the SPC maplet and the registered mapola of one name to the fused maplet's grid."""
    spc = lidar = np.full(fused.grid.shape, np.nan)
    if workspace.maplet_path(fused.name).is_file():
        spc = project_maplet(workspace.maplet(fused.name), fused.grid).height
    if transform is not None and fused.name in workspace.mapola_names():
        moved = workspace.mapola(fused.name).moved(transform)
        lidar = project_maplet(moved, fused.grid).height
    return Surfaces(fused, spc, lidar)


def _coverage(workspace: Workspace) -> Coverage | None:
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


def _planted(workspace: Workspace) -> tuple[Recovered, ...]:
    """Read what a demo planted."""
    content = _optional_json(workspace, workspace.root / PLANTED_FILE)
    if content is None:
        return ()
    try:
        return tuple(_recovered(entry) for entry in content["planted"])
    except (KeyError, TypeError, ValueError) as error:
        path = workspace.root / PLANTED_FILE
        raise FormatError(f"does not state what was planted ({error})", path) from error


def _recovered(entry: dict[str, Any]) -> Recovered:
    """Read one planted value; null is NaN."""
    planted, recovered, sigma = (
        float("nan") if entry[key] is None else float(entry[key])
        for key in ("planted", "recovered", "sigma")
    )
    return Recovered(str(entry["name"]), planted, recovered, sigma, str(entry["unit"]))
