"""The scale from single shots of all scans against the shape."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from fusion.estimation.verdict import Finding, Severity
from fusion.pipeline import StageContext
from fusion.scaling.fit import ScaleEstimate, ScaleOptions, TrajectorySource
from fusion.scaling.geometry import LidarPlacement
from fusion.scaling.judging import (
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
from fusion.scaling.results import assumed_json, per_shot, place_json, scale_json, scan_places_json
from fusion.scaling.shots import (
    ShotComparison,
    SpotOptions,
    compare_shots,
    iterate_shots,
    join_shots,
)
from fusion.scene.geolocation import LocatedShots, geolocator, located_shots
from fusion.stages.scale.pairing import state_shares
from fusion.stages.scale.result import ScaleResult, scale_options, unobserved
from fusion.workspace import Workspace
from fusion.workspace.settings.inputs import SpiceSettings, SpinSettings
from fusion.workspace.settings.processing import ScaleSettings
from lidar.geolocation import geolocated_by
from lidar.scans import Scan, join
from spcola.arrays import FloatArray
from spcola.errors import InvalidValueError, NotObservableError
from spcola.navigation import Trajectory
from spcola.shape import RayCaster

# A scan, and the shares of states in the places of its shots.
_PlacedScan = tuple[Scan, FloatArray | None]
# Applies a function to groups of scans.
_Each = Callable[[Callable[[Scan], PlaceCheck], list[Scan]], Iterable[PlaceCheck]]


def scale_by_shots(context: StageContext, caster: RayCaster, radius: float) -> ScaleResult:
    """Estimate the scale from single shots of all scans against the shape.

    Parameters
    ----------
    context : StageContext
    caster : RayCaster
        Ray caster of the SPC shape.
    radius : float
        Mean radius of the body, metres.
    """
    shots, table = _Shots.of(context, caster), context.table(ScaleSettings)
    compared = shots.compared(LidarPlacement())
    if len(compared.observations) < 2:
        reason = shots.taken.unplaced(compared.missed, shots.trajectory)
        return shots.unobserved(reason, missed=compared.missed)
    options = scale_options(table)
    try:
        compared, estimate = iterate_shots(compared, shots.compared, options=options)
    except NotObservableError as error:
        return shots.unobserved(str(error))
    content = scale_json(compared.observations, estimate, mean_radius=radius)
    if shots.trajectory != table.trajectory:
        content["reasons"].append(
            "trajectory: there are no images with SPC states, so the shots are located by "
            f"{'the kernels of [spice]' if shots.taken.place else 'their own reference trajectory'}"
            ": epsilon is that of the shape alone"
        )
    checks, at_place = shots.checks(compared, estimate, options)
    content["reasons"] += [
        f"misfit: {finding.text}" for finding in at_place if finding.severity is not Severity.NOTE
    ]
    content |= {
        **checks,
        "assumed": assumed_json(shots.spots),
        "missed": compared.missed,
        **shots.taken.as_json(),
    }
    if shots.taken.place is not None or shots.trajectory == "spc":
        content["located_within_m"] = shots.taken.within_m
    content["per_shot"] = per_shot(compared, estimate)
    findings = scale_findings(compared.observations, estimate, options)
    findings += lost_findings("shots", compared.missed, len(compared.hits))
    return ScaleResult(content, [*findings, *at_place, *shots.taken.findings()])


def seconds_of_estimate(context: StageContext, caster: RayCaster) -> float:
    """Return the time of the estimate from the shots of a context, without other places."""
    shots = _Shots.of(context, caster)
    options = scale_options(context.table(ScaleSettings))
    begun = time.perf_counter()
    # Few shots may not determine what all do.
    with suppress(NotObservableError):
        iterate_shots(shots.compared(LidarPlacement()), shots.compared, options=options)
    return time.perf_counter() - begun


def seconds_of_searches(context: StageContext, caster: RayCaster) -> float:
    """Return the time of reading the shots and searching other places, by that of some scans."""
    begun = time.perf_counter()
    shots = _Shots.of(context, caster)
    options = scale_options(context.table(ScaleSettings))
    left = 0.0

    def some(check: Callable[[Scan], PlaceCheck], groups: list[Scan]) -> list[PlaceCheck]:
        nonlocal left
        chosen, start = groups[: context.executor.workers], time.perf_counter()
        found = list(context.executor.stream(check, chosen))
        left = (len(groups) / len(chosen) - 1.0) * (time.perf_counter() - start)
        return found

    if shots.placed:
        shots.places(options, LidarPlacement(), some)
    return time.perf_counter() - begun + left


@dataclass(frozen=True, eq=False)
class _Shots:
    """The geolocated shots of a workspace, and their comparison with the shape."""

    context: StageContext
    caster: RayCaster
    taken: LocatedShots
    placed: list[_PlacedScan]
    trajectory: TrajectorySource
    spots: SpotOptions

    @classmethod
    def of(cls, context: StageContext, caster: RayCaster) -> _Shots:
        """Read and geolocate the shots; by the states of images only if there are images."""
        workspace, table = context.workspace, context.table(ScaleSettings)
        locator = geolocator(
            workspace,
            context.table(SpinSettings),
            context.table(SpiceSettings),
            max_gap_s=table.max_gap_s,
        )
        chosen = context.chosen({path.stem: path for path in workspace.scan_paths()}).values()
        taken = located_shots(list(chosen), locator, table.max_shots)
        trajectory = table.trajectory if workspace.image_names() else "reference"
        spots = SpotOptions(table.footprint_mrad / 1e3, table.pointing_sigma_mrad / 1e3)
        placed: list[_PlacedScan] = [(scan, None) for scan in taken.scans]
        if trajectory == "spc":
            taken, placed = _located_by_states(taken, workspace, table.max_gap_s)
        return cls(context, caster, taken, placed, trajectory, spots)

    def each(self, known: LidarPlacement) -> list[ShotComparison]:
        """Compare the shots of each scan with the shape, the lidar placed as `known`."""
        # Workers get what the function refers to: not the whole context.
        one = partial(
            _compared,
            caster=self.caster,
            trajectory=self.trajectory,
            spots=self.spots,
            known=known,
        )
        return self.context.map("cast shots", one, self.placed)

    def compared(self, known: LidarPlacement) -> ShotComparison:
        """Compare all shots."""
        return join_shots(self.each(known))

    def unobserved(self, reason: str, **content: Any) -> ScaleResult:
        """Return the result if the shots determine nothing."""
        found = unobserved("shots", self.trajectory, reason, **self.taken.as_json(), **content)
        found.findings.extend(self.taken.findings())
        return found

    def checks(
        self, compared: ShotComparison, estimate: ScaleEstimate, options: ScaleOptions
    ) -> tuple[dict[str, Any], list[Finding]]:
        """Search for other places at which all shots, or those of single scans, fit the shape."""
        known = LidarPlacement.of(estimate.fit.estimate)
        each = partial(self.context.map, "search other places of scans")
        check, by_scan = self.places(options, known, each)
        crossings = compare_crossings(self.each(known), options.prior, known)
        content = {
            "longitude_check": place_json(check),
            "scan_check": scan_places_json(by_scan, crossings),
        }
        scatter = expected_scatter(compared.observations, options)
        return content, [*place_findings(check, scatter), *scan_findings(by_scan, crossings)]

    def places(
        self, options: ScaleOptions, known: LidarPlacement, each: _Each
    ) -> tuple[PlaceCheck, ScanChecks]:
        """Search where all shots fit the shape; if that is not elsewhere, where single scans do."""
        scans = [scan for scan, _ in self.placed]
        given: Any = {"prior": options.prior, "known": known, "trajectory": self.trajectory}
        check = check_place(join("shots", scans), self.caster, **given)
        if check.misfit:
            return check, ScanChecks()
        return check, check_scans(scans, self.caster, each=each, **given)


def _compared(
    placed: _PlacedScan,
    *,
    caster: RayCaster,
    trajectory: TrajectorySource,
    spots: SpotOptions,
    known: LidarPlacement,
) -> ShotComparison:
    """Compare the shots of one scan with the shape."""
    scan, shares = placed
    return compare_shots(
        scan, caster, trajectory=trajectory, shares=shares, spots=spots, known=known
    )


def _located_by_states(
    taken: LocatedShots, workspace: Workspace, max_gap_s: float
) -> tuple[LocatedShots, list[_PlacedScan]]:
    """Return shots geolocated by SPC states of images, with the shares of states in them."""
    states = Trajectory.from_images(workspace.images())
    moved = [_by_states(scan, states, max_gap_s) for scan in taken.scans]
    widest = max((within for _, _, within in moved), default=0.0)
    placed: list[_PlacedScan] = [(scan, shares) for scan, shares, _ in moved]
    return taken.moved(tuple(scan for scan, _ in placed), widest), placed


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
