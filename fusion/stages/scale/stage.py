"""Scale: lidar ranges against the SPC solution, by paired bigmaps or by single shots."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fusion.estimation import influence
from fusion.pipeline import StageContext, StageResult
from fusion.scaling.fit import ScaleEstimate, ScaleOptions, TrajectorySource, estimate_scale
from fusion.scaling.geometry import LidarPlacement
from fusion.scaling.judging import (
    consistency,
    consistency_findings,
    covariance_by_maplets,
    expected_scatter,
    lost_findings,
    place_findings,
    scale_findings,
    scan_findings,
)
from fusion.scaling.misplacement import (
    PlaceCheck,
    ScanChecks,
    check_place,
    check_scans,
    compare_crossings,
)
from fusion.scaling.pairs import pair_maplet_shares, pair_observations
from fusion.scaling.results import (
    assumed_json,
    per_pair,
    per_shot,
    place_json,
    scale_json,
    scan_places_json,
    unobserved_json,
    unused_pairs,
)
from fusion.scaling.shots import (
    ShotComparison,
    SpotOptions,
    compare_shots,
    iterate_shots,
    join_shots,
)
from fusion.stages.geolocation.located import LocatedShots, located_shots
from fusion.stages.geolocation.locating import geolocator, kernel_paths
from fusion.stages.ingest.sources import check_doubles, whole_scans
from fusion.stages.scale.pairing import Pairing, pair_images, state_shares, write_pairs
from fusion.verdict import Code, Finding, Severity, Verdict
from fusion.workspace import Workspace
from fusion.workspace.settings import (
    BodySettings,
    ScaleSettings,
    Settings,
    SpiceSettings,
    SpinSettings,
    Table,
)
from lidar.geolocation import geolocated_by
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
        """Return why no scale can be estimated; empty if it can."""
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
        """Return scans, shape, images, the registration if there is one, and maplets for pairs."""
        paths = [*workspace.scan_paths(), workspace.shape_path()]
        paths += kernel_paths(workspace, settings.spice)
        if workspace.registration_path.is_file():
            paths += [workspace.registration_path, *workspace.mapola_paths()]
        paths += [workspace.image_path(name) for name in workspace.image_names()]
        if settings.scale.method == "pairs":
            paths += workspace.maplet_files()
        return paths

    def run(self, context: StageContext) -> StageResult:
        """Compare, estimate jointly, write; also if nothing can be compared."""
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


# A scan, and the shares of states in the places of its shots.
_PlacedScan = tuple[Scan, FloatArray | None]


def _shots(
    context: StageContext, caster: RayCaster, radius: float
) -> tuple[dict[str, Any], list[Finding]]:
    """Estimate the scale from single shots of all scans against the shape."""
    workspace, table = context.workspace, context.table(ScaleSettings)
    locator = geolocator(
        workspace,
        context.table(SpinSettings),
        context.table(SpiceSettings),
        max_gap_s=table.max_gap_s,
    )
    taken = located_shots(workspace, locator, table.max_shots)
    located = table.trajectory if workspace.image_names() else "reference"
    spots = SpotOptions(table.footprint_mrad / 1e3, table.pointing_sigma_mrad / 1e3)
    placed: list[_PlacedScan] = [(scan, None) for scan in taken.scans]
    if located == "spc":
        taken, placed = _located_by_states(taken, workspace, table.max_gap_s)

    def one(placed: _PlacedScan, known: LidarPlacement) -> ShotComparison:
        scan, shares = placed
        return compare_shots(
            scan, caster, trajectory=located, shares=shares, spots=spots, known=known
        )

    def each(known: LidarPlacement) -> list[ShotComparison]:
        return context.map("cast shots", partial(one, known=known), placed)

    def at(known: LidarPlacement) -> ShotComparison:
        return join_shots(each(known))

    compared = at(LidarPlacement())
    if len(compared.observations) < 2:
        content, findings = _unobserved("shots", located, taken.unplaced(compared.missed, located))
        content |= taken.as_json() | {"missed": compared.missed}
        return content, [*findings, *taken.findings()]
    options = _scale_options(table)
    try:
        compared, estimate = iterate_shots(compared, at, options=options)
    except NotObservableError as error:
        content, findings = _unobserved("shots", located, str(error))
        return content | taken.as_json(), [*findings, *taken.findings()]
    known = LidarPlacement.of(estimate.fit.estimate)
    check, by_scan = _placed(
        [scan for scan, _ in placed], caster, options=options, known=known, located=located
    )
    crossings = compare_crossings(each(known), options.prior, known)
    content = scale_json(compared.observations, estimate, mean_radius=radius)
    if located != table.trajectory:
        content["reasons"].append(
            "trajectory: there are no images with SPC states, so the shots are located by "
            f"{'the kernels of [spice]' if locator.place else 'their own reference trajectory'}: "
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
    if locator.place is not None or located == "spc":
        content["located_within_m"] = taken.within_m
    content["per_shot"] = per_shot(compared, estimate)
    findings = scale_findings(compared.observations, estimate, options)
    findings += lost_findings("shots", compared.missed, len(compared.hits))
    return content, [*findings, *at_place, *taken.findings()]


def _located_by_states(
    taken: LocatedShots, workspace: Workspace, max_gap_s: float
) -> tuple[LocatedShots, list[_PlacedScan]]:
    """Return shots geolocated by SPC states of images, with the shares of states in them."""
    states = Trajectory.from_images(workspace.images())
    moved = [_by_states(scan, states, max_gap_s) for scan in taken.scans]
    widest = max((within for _, _, within in moved), default=0.0)
    placed: list[_PlacedScan] = [(scan, shares) for scan, shares, _ in moved]
    return taken.moved(tuple(scan for scan, _ in placed), widest), placed


def _placed(
    scans: list[Scan],
    caster: RayCaster,
    *,
    options: ScaleOptions,
    known: LidarPlacement,
    located: TrajectorySource,
) -> tuple[PlaceCheck, ScanChecks]:
    """Search where all shots fit the shape and, if that is not elsewhere, where single scans do."""
    check = check_place(
        join("shots", scans), caster, prior=options.prior, known=known, trajectory=located
    )
    if check.misfit:
        return check, ScanChecks()
    return check, check_scans(scans, caster, prior=options.prior, known=known, trajectory=located)


def _unobserved(kind: str, located: str, reason: str) -> tuple[dict[str, Any], list[Finding]]:
    """Return content and findings if nothing is observed."""
    refused = Finding(Code.SCALE_NOT_OBSERVED, Severity.REFUSED, reason)
    return unobserved_json(kind, located, reason), [refused]


def _by_states(scan: Scan, states: Trajectory, max_gap_s: float) -> tuple[Scan, FloatArray, float]:
    """Geolocate shots by SPC states; return the share (N, S) of each state in each shot too.

    Without a state during the scan no shot is left. The last value is one standard deviation of
    interpolated places between the two states that are furthest apart, metres.
    """
    try:
        again, offset = geolocated_by(scan, states, max_gap_s=max_gap_s)
    except InvalidValueError:
        return scan.select(np.zeros(len(scan), dtype=bool)), np.zeros((0, len(states))), 0.0
    shares = state_shares(states, offset, again.time).toarray()
    return again, shares, offset.widest(max_gap_s)


def _pairs(
    context: StageContext, caster: RayCaster, radius: float
) -> tuple[dict[str, Any], list[Finding], list[Path]]:
    """Estimate the scale from paired bigmaps of all images."""
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
        content |= {"per_pair": unused_pairs(left_out), **_located(context, made)}
        return content, findings, files
    per_axis = np.sqrt(np.mean(made.center_sigma**2, axis=1))
    observations = pair_observations(pairs, table.trajectory, center_sigma=per_axis)
    options = _scale_options(table)
    try:
        estimate = estimate_scale(observations, options=options)
    except NotObservableError as error:
        content, findings = _unobserved("pairs", table.trajectory, str(error))
        return content | {"per_pair": unused_pairs(left_out)}, findings, files
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
    findings += lost_findings("pairs", unmatched, unmatched + len(pairs))
    if workspace.registration_path.is_file() and table.trajectory == "spc":
        content[_SHARED] = _shared_with_registration(workspace, made, estimate)
    return content, findings, files


def _located(context: StageContext, made: Pairing) -> dict[str, Any]:
    """Return entries on the geolocation of the returns of pairs; empty without one."""
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
    """Return the covariance of ε and the registration's scale by shared maplets; None if unknown.

    If states geolocate the returns of pairs, ε does not depend on trajectories of scans. A
    registration by images depends on these states too; that covariance is not known.
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
    # A displaced maplet displaces SPC against the lidar in a pair, and its mapola.
    of_epsilon = -pair_maplet_shares(made.pairs).T @ influence(estimate.equations, estimate.fit)[0]
    return covariance_by_maplets(of_epsilon, of_scale, made.center_sigma)
