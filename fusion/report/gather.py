"""Gather the content of the report from a workspace."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from fusion.estimation.verdict import Verdict
from fusion.fusing.maplets import FUSED_HDF5, FusedMaplet, fused_names, read_fused
from fusion.pipeline.catalog import read_records
from fusion.products import versions
from fusion.registration.results import transform_of
from fusion.report.data import LidarCoverage, Origins, ReportData, Surfaces
from fusion.report.photoclinometry import gather_solved
from fusion.report.planted import read_planted
from fusion.workspace import Workspace
from spcola.arrays import FloatArray
from spcola.grids import project_maplet
from spcola.math import Affine

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
    registration = workspace.find_json(workspace.registration_path.name)
    scale = workspace.find_json(workspace.scale_path.name)
    refused = registration is not None and registration.get("verdict") == "refused"
    surfaces, origins = ((), None) if refused else _places(workspace)
    planted, errors = read_planted(workspace)
    return ReportData(
        body=body,
        surfaces=surfaces,
        coverage=gather_coverage(workspace),
        registration=registration,
        scale=scale,
        planted=planted,
        versions=versions(),
        verdicts=_verdicts(workspace),
        accepted=tuple(accepted),
        origins=origins,
        errors=errors,
        solved=gather_solved(workspace),
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


def fused_places(workspace: Workspace, *, most: int | None = None) -> Iterator[Surfaces]:
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
    folder = workspace.home / "fused"
    if not (folder / FUSED_HDF5).is_file():
        return
    registration = workspace.find_json(workspace.registration_path.name)
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
    for place in fused_places(workspace, most=_LOOKED_AT):
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


def gather_coverage(workspace: Workspace) -> LidarCoverage | None:
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
    return LidarCoverage(
        np.stack(list(centers.values())), np.array([share[name] for name in centers])
    )
