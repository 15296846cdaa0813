"""Scale: lidar ranges against the SPC solution, by paired bigmaps or by single shots."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fusion.estimation import influence
from fusion.estimation.verdict import Finding, Severity, Verdict
from fusion.pipeline import StageContext, StageResult
from fusion.scaling.fit import ScaleEstimate, ScaleOptions, estimate_scale
from fusion.scaling.fit import Trajectory as Located
from fusion.scaling.geometry import KnownPlace
from fusion.scaling.judging import (
    consistency,
    consistency_findings,
    expected_scatter,
    missed_findings,
    place_findings,
    scale_findings,
    scan_findings,
    shared_by_maplets,
    unmatched_findings,
    unobserved_findings,
)
from fusion.scaling.pairs import maplets_under, pair_observations
from fusion.scaling.places import (
    PlaceCheck,
    ScanPlaces,
    check_place,
    check_scans,
    compare_crossings,
)
from fusion.scaling.results import (
    assumed_json,
    per_pair,
    per_shot,
    place_json,
    scale_json,
    scan_places_json,
    silent_pairs,
    unobserved_json,
)
from fusion.scaling.shots import (
    ShotComparison,
    SpotOptions,
    compare_shots,
    join_shots,
    settle_shots,
)
from fusion.stages.geolocation.located import LocatedShots, located_shots
from fusion.stages.geolocation.locating import kernel_paths, turning
from fusion.stages.ingest.sources import check_doubles, whole_scans
from fusion.stages.scale.pairing import (
    Pairing,
    pair_images,
    state_shares,
    write_pairs,
)
from fusion.workspace import Workspace
from fusion.workspace.settings import (
    BodySettings,
    ScaleSettings,
    Settings,
    SpiceSettings,
    SpinSettings,
    Table,
)
from lidar.geolocation import reproject, scan_trajectory
from lidar.scans import Scan, join
from spcola.arrays import FloatArray
from spcola.errors import InvalidValueError, NotObservableError
from spcola.navigation import Trajectory
from spcola.shape import RayCaster


@dataclass(frozen=True)
class ScaleStage:
    """Scans, images and SPC surface → scale.json and pairs/."""

    name: str = "scale"
    version: int = 12
    needs: tuple[str, ...] = ("ingest", "register")
    places: tuple[str, ...] = ("scale.json", "pairs")
    tables: tuple[type[Table], ...] = (
        ScaleSettings,
        BodySettings,
        SpinSettings,
        SpiceSettings,
    )

    def missing(self, workspace: Workspace, settings: Settings) -> str:
        """Return why there is no scale to be found."""
        if not workspace.scan_names():
            return f"there are no scans; run: spcola import {workspace.root} FILE"
        if not workspace.has_shape():
            return "there is no shape in SHAPEFILES to cast rays on"
        if settings.scale.method == "pairs":
            if not workspace.image_names():
                return "there are no images in SUMFILES to pair; use --method shots"
            if not workspace.maplet_names():
                return "there are no maplets in MAPFILES to pair; use --method shots"
        return ""

    def inputs(self, workspace: Workspace, settings: Settings) -> list[Path]:
        """Return scans, shape, images, the registration if there is one; for pairs maplets."""
        paths = [*workspace.scan_paths(), workspace.shape_path()]
        paths += kernel_paths(workspace, settings.spice)
        if workspace.registration_path.is_file():
            paths += [workspace.registration_path, *workspace.mapola_paths()]
        paths += [workspace.image_path(name) for name in workspace.image_names()]
        if settings.scale.method == "pairs":
            paths += workspace.maplet_files()
        return paths

    def run(self, context: StageContext) -> StageResult:
        """Compare, estimate jointly, write; that nothing can be compared is written too."""
        workspace, table = context.workspace, context.table(ScaleSettings)
        check_doubles(workspace, whole_scans(workspace).items())
        shape = workspace.shape()
        radius = context.table(BodySettings).mean_radius_m or shape.mean_radius
        caster = RayCaster(shape)
        files: list[Path] = []
        if table.method == "shots":
            content, findings = _shots(context, caster, radius)
        else:
            content, findings, files = _pairs(context, caster, radius)
        if workspace.registration_path.is_file():
            registration = workspace.read_json(workspace.registration_path.name)
            compared = consistency(content, registration, content.pop(_SHARED, None))
            content["registration_consistency"] = compared
            findings += consistency_findings(compared)
        content |= Verdict(tuple(findings)).as_json()
        path = context.write_json(workspace.scale_path.name, content)
        summary = {k: v for k, v in content.items() if k not in _LONG}
        return StageResult((path, *files), summary)


STAGE = ScaleStage()

_SHARED = "covariance_with_registration"
_LONG = frozenset({"per_pair", "per_shot", "covariance", "parameters"})


def _scale_options(table: ScaleSettings) -> ScaleOptions:
    return ScaleOptions(
        center_prior_m=table.center_prior_m,
        meridian_prior_deg=table.meridian_prior_deg,
        pole_prior_deg=table.pole_prior_deg,
        range_bias_prior_m=table.range_bias_prior_m,
        single_sigma_m=table.single_sigma_m,
        state_sigma_m=table.state_sigma_m,
        scan_sigma_m=table.scan_sigma_m,
        day_sigma_m=table.day_sigma_m,
        reject=table.reject_sigmas,
    )


# A scan, and what the errors of the states by which it is located do to its shots.
_PlacedScan = tuple[Scan, FloatArray | None]


def _shots(
    context: StageContext, caster: RayCaster, radius: float
) -> tuple[dict[str, Any], list[Finding]]:
    """Single shots of all scans against the shape."""
    workspace, table = context.workspace, context.table(ScaleSettings)
    turn = turning(
        workspace,
        context.table(SpinSettings),
        context.table(SpiceSettings),
        max_gap_s=table.max_gap_s,
    )
    taken = located_shots(workspace, turn, table.max_shots)
    located = table.trajectory if workspace.image_names() else "reference"
    spots = SpotOptions(table.footprint_mrad / 1e3, table.pointing_sigma_mrad / 1e3)
    placed: list[_PlacedScan] = [(scan, None) for scan in taken.scans]
    if located == "spc":
        taken, placed = _relocated_scans(taken, workspace, table.max_gap_s)

    def one(placed: _PlacedScan, known: KnownPlace) -> ShotComparison:
        scan, shares = placed
        return compare_shots(
            scan, caster, trajectory=located, shares=shares, spots=spots, known=known
        )

    def each(known: KnownPlace) -> list[ShotComparison]:
        return context.map("cast shots", partial(one, known=known), placed)

    def at(known: KnownPlace) -> ShotComparison:
        return join_shots(each(known))

    compared = at(KnownPlace())
    if len(compared.observations) < 2:
        content, findings = _unobserved("shots", located, taken.unplaced(compared.missed, located))
        content |= taken.as_json() | {"missed": compared.missed}
        return content, [*findings, *taken.findings()]
    options = _scale_options(table)
    try:
        compared, estimate = settle_shots(compared, at, options=options)
    except NotObservableError as error:
        content, findings = _unobserved("shots", located, str(error))
        return content | taken.as_json(), [*findings, *taken.findings()]
    known = KnownPlace.of(estimate.fit.estimate)
    check, by_scan = _placed(
        [scan for scan, _ in placed], caster, options=options, known=known, located=located
    )
    crossings = compare_crossings(each(known), options.prior, known)
    content = scale_json(compared.observations, estimate, mean_radius=radius)
    if located != table.trajectory:
        content["reasons"].append(
            "trajectory: there are no images with SPC states, so the shots are located by "
            f"{'the kernels of [spice]' if turn.place else 'their own reference trajectory'}: "
            "epsilon is that of the shape alone"
        )
    at_place = [
        *place_findings(check, expected_scatter(compared.observations, options)),
        *scan_findings(by_scan, crossings),
    ]
    content["reasons"] += [
        f"misfit: {finding.text}" for finding in at_place if finding.severity is not Severity.NOTE
    ]
    content |= {
        "longitude_check": place_json(check),
        "scan_check": scan_places_json(by_scan, crossings),
        "assumed": assumed_json(spots),
        "missed": compared.missed,
        **taken.as_json(),
    }
    if turn.place is not None or located == "spc":
        content["located_within_m"] = taken.within_m
    content["per_shot"] = per_shot(compared, estimate)
    findings = scale_findings(compared.observations, estimate, options)
    findings += missed_findings(compared.missed, len(compared.met))
    return content, [*findings, *at_place, *taken.findings()]


def _relocated_scans(
    taken: LocatedShots, workspace: Workspace, max_gap_s: float
) -> tuple[LocatedShots, list[_PlacedScan]]:
    """Shots located by the SPC states of images, with what the states' errors do to them."""
    states = Trajectory.from_images(workspace.images())
    moved = [_relocated(scan, states, max_gap_s) for scan in taken.scans]
    widest = max((within for _, _, within in moved), default=0.0)
    placed: list[_PlacedScan] = [(scan, shares) for scan, shares, _ in moved]
    return taken.moved(tuple(scan for scan, _ in placed), widest), placed


def _placed(
    scans: list[Scan],
    caster: RayCaster,
    *,
    options: ScaleOptions,
    known: KnownPlace,
    located: Located,
) -> tuple[PlaceCheck, ScanPlaces]:
    """Where the shots fit together, and where scans do one by one if not together elsewhere."""
    check = check_place(
        join("shots", scans), caster, prior=options.prior, known=known, trajectory=located
    )
    if check.misfit:
        return check, ScanPlaces()
    return check, check_scans(scans, caster, prior=options.prior, known=known, trajectory=located)


def _unobserved(kind: str, located: str, reason: str) -> tuple[dict[str, Any], list[Finding]]:
    """Content and findings where nothing is observed."""
    return unobserved_json(kind, located, reason), unobserved_findings(reason)


def _relocated(scan: Scan, states: Trajectory, max_gap_s: float) -> tuple[Scan, FloatArray, float]:
    """Locate shots by SPC states, and tell on which of these (N, S) each leans.

    No shot is left where no state falls into the scan. The last is one standard deviation of what
    is interpolated between states, where they lie furthest apart, metres.
    """
    try:
        offset = states.offset_from(scan_trajectory(scan), max_gap_s=max_gap_s)
    except InvalidValueError:
        return scan.select(np.zeros(len(scan), dtype=bool)), np.zeros((0, len(states))), 0.0
    again = reproject(scan, states, max_gap_s=max_gap_s)
    shares = state_shares(states, offset, again.time).toarray()
    return again, shares, offset.widest(max_gap_s)


def _pairs(
    context: StageContext, caster: RayCaster, radius: float
) -> tuple[dict[str, Any], list[Finding], list[Path]]:
    """Paired bigmaps of all images."""
    workspace, table = context.workspace, context.table(ScaleSettings)
    made = pair_images(context, caster, radius)
    pairs, left_out = made.pairs, made.left_out
    files = write_pairs(workspace, pairs)
    if len(pairs) < 2:
        why = "; ".join(sorted({item.reason for item in left_out})) or "there are no images"
        content, findings = _unobserved(
            "pairs",
            table.trajectory,
            f"{len(pairs)} of {len(pairs) + len(left_out)} images give a pair ({why}); add scans "
            "taken with the images, or widen [scale] capture_m",
        )
        content |= {"per_pair": silent_pairs(left_out), **_located(context, made)}
        return content, findings, files
    per_axis = np.sqrt(np.mean(made.center_sigma**2, axis=1))
    observations = pair_observations(pairs, table.trajectory, center_sigma=per_axis)
    options = _scale_options(table)
    try:
        estimate = estimate_scale(observations, options=options)
    except NotObservableError as error:
        content, findings = _unobserved("pairs", table.trajectory, str(error))
        return content | {"per_pair": silent_pairs(left_out)}, findings, files
    content = scale_json(observations, estimate, mean_radius=radius)
    content |= {
        "size_m": made.options.size_m,
        "gsd_m": made.options.gsd_m,
        "blur_cells": made.blur_cells,
        "per_pair": per_pair(pairs, left_out, observations, estimate),
        **_located(context, made),
    }
    unmatched = sum(item.unmatched for item in left_out)
    findings = scale_findings(observations, estimate, options)
    findings += unmatched_findings(unmatched, unmatched + len(pairs))
    if workspace.registration_path.is_file() and table.trajectory == "spc":
        content[_SHARED] = _shared_with_registration(workspace, made, estimate)
    return content, findings, files


def _located(context: StageContext, made: Pairing) -> dict[str, Any]:
    """Return what is known of how the returns of pairs were located again; nothing if not."""
    kernels = context.table(SpiceSettings).kernels
    content: dict[str, Any] = {}
    if kernels or context.table(ScaleSettings).trajectory == "spc":
        content["located_within_m"] = made.located_within_m
    if made.without_place:
        content["returns_without_place"] = made.without_place
    return content


def _shared_with_registration(
    workspace: Workspace, made: Pairing, estimate: ScaleEstimate
) -> float | None:
    """Covariance of ε and the registration's scale by the maplets under both; None if not known.

    Where states locate the returns of pairs, trajectories of scans are no part of ε. A registration
    by images leans on these states too, and does not say how.
    """
    registration = workspace.read_json(workspace.registration_path.name)
    moved = {
        str(entry["name"]): np.array(entry["scale_per_m"])
        for entry in registration["per_mapola"]
        if "scale_per_m" in entry
    }
    if not moved:
        return None
    of_scale = np.array([moved.get(name, np.zeros(3)) for name in made.maplets]).reshape(-1, 3)
    # What moves a maplet moves SPC against the lidar in a pair, and its mapola with it.
    of_epsilon = -maplets_under(made.pairs).T @ influence(estimate.equations, estimate.fit)[0]
    return shared_by_maplets(of_epsilon, of_scale, made.center_sigma)
