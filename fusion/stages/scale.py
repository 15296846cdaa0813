"""Scale: lidar ranges against the SPC solution, by paired bigmaps or by single shots."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fusion.influence import influence
from fusion.located import LocatedShots, located_shots
from fusion.locating import kernel_paths, turning
from fusion.pairing import Pairing, pair_images, state_shares, write_pairs
from fusion.scaling.consistency import consistency, shared_by_maplets
from fusion.scaling.joint import ScaleEstimate, ScaleOptions, estimate_scale
from fusion.scaling.pairs import maplets_under, pair_observations
from fusion.scaling.placing import KnownPlace
from fusion.scaling.settling import settle_shots
from fusion.scaling.shots import ShotComparison, check_longitude, compare_shots, join_shots
from fusion.scaling.spots import SpotOptions
from fusion.scaling.summary import (
    assumed_json,
    longitude_json,
    per_pair,
    per_shot,
    scale_json,
    silent_pairs,
    unobserved_json,
)
from fusion.settings import Settings
from fusion.stages.base import StageContext, StageResult
from fusion.tables import BodySettings, ScaleSettings, SpiceSettings, SpinSettings, Table
from fusion.verdict import Verdict
from fusion.workspace import Workspace
from lidar.reprojection import reproject, scan_trajectory
from lidar.scan import Scan, join
from spcola.arrays import FloatArray
from spcola.errors import InvalidValueError
from spcola.rays import RayCaster
from spcola.trajectory import Trajectory


@dataclass(frozen=True)
class ScaleStage:
    """Scans, images and SPC surface → scale.json and pairs/."""

    name: str = "scale"
    version: int = 9
    needs: tuple[str, ...] = ("ingest",)
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
        shape = workspace.shape()
        radius = context.table(BodySettings).mean_radius_m or shape.mean_radius
        caster = RayCaster(shape)
        files: list[Path] = []
        if table.method == "shots":
            content = _shots(context, caster, radius)
        else:
            content, files = _pairs(context, caster, radius)
        if workspace.registration_path.is_file():
            registration = workspace.read_json(workspace.registration_path.name)
            content["registration_consistency"] = consistency(
                content, registration, content.pop(_SHARED, None)
            )
        content.pop(_SHARED, None)
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


def _shots(context: StageContext, caster: RayCaster, radius: float) -> dict[str, Any]:
    """Single shots of all scans against the shape."""
    workspace, table = context.workspace, context.table(ScaleSettings)
    turn = turning(
        workspace,
        context.table(SpinSettings),
        context.table(SpiceSettings),
        max_gap_s=table.max_gap_s,
    )
    taken = located_shots(workspace, turn, table.max_shots)
    scans = taken.scans
    located = table.trajectory if workspace.image_names() else "reference"
    states = Trajectory.from_images(workspace.images()) if located == "spc" else None

    spots = SpotOptions(table.footprint_mrad / 1e3, table.pointing_sigma_mrad / 1e3)

    placed: list[tuple[Scan, FloatArray | None]] = [(scan, None) for scan in scans]
    if states is not None:
        moved = [_relocated(scan, states, table.max_gap_s) for scan in scans]
        placed = [(scan, shares) for scan, shares, _ in moved]
        widest = max((within for _, _, within in moved), default=0.0)
        taken = taken.moved(tuple(scan for scan, _ in placed), widest)

    def one(placed: tuple[Scan, FloatArray | None], known: KnownPlace) -> ShotComparison:
        scan, shares = placed
        return compare_shots(
            scan, caster, trajectory=located, shares=shares, spots=spots, known=known
        )

    def at(known: KnownPlace) -> ShotComparison:
        return join_shots(context.map("cast shots", partial(one, known=known), placed))

    compared, scan = at(KnownPlace()), join("shots", list(scans))
    if len(compared.observations) < 2:
        content = unobserved_json("shots", located, taken.unplaced(compared.missed, located))
        return content | taken.as_json() | {"missed": compared.missed} | _verdict(content, taken)
    compared, estimate = settle_shots(compared, at, options=_scale_options(table))
    check = check_longitude(scan, caster)
    content = scale_json(compared.observations, estimate, mean_radius=radius)
    if located != table.trajectory:
        content["reasons"].append(
            "trajectory: there are no images with SPC states, so the shots are located by "
            f"{'the kernels of [spice]' if turn.place else 'their own reference trajectory'}: "
            "epsilon is that of the shape alone"
        )
    if check.misfit:
        content["reasons"].append(
            f"misfit: turned by {check.best_deg:+.0f} deg about Z the shots scatter by "
            f"{check.best_m:.2f} m instead of {check.here_m:.2f} m (p = {check.p_value:.1e})"
        )
    content["longitude_check"] = longitude_json(check)
    content["assumed"] = assumed_json(spots)
    content["missed"] = compared.missed
    content |= taken.as_json()
    if turn.place is not None or states is not None:
        content["located_within_m"] = taken.within_m
    content["per_shot"] = per_shot(compared, estimate)
    return content | _verdict(content, taken)


def _verdict(content: dict[str, Any], taken: LocatedShots) -> dict[str, Any]:
    """Return the verdict of a scale, with what was found where its shots were located."""
    return Verdict((*Verdict.from_json(content).findings, *taken.findings())).as_json()


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
) -> tuple[dict[str, Any], list[Path]]:
    """Paired bigmaps of all images."""
    workspace, table = context.workspace, context.table(ScaleSettings)
    made = pair_images(context, caster, radius)
    pairs, left_out = made.pairs, made.left_out
    if len(pairs) < 2:
        why = "; ".join(sorted({item.reason for item in left_out})) or "there are no images"
        content = unobserved_json(
            "pairs",
            table.trajectory,
            f"{len(pairs)} of {len(pairs) + len(left_out)} images give a pair ({why}); add scans "
            "taken with the images, or widen [scale] capture_m",
        )
        content |= {"per_pair": silent_pairs(left_out), **_located(context, made)}
        return content, write_pairs(workspace, pairs)
    per_axis = np.sqrt(np.mean(made.center_sigma**2, axis=1))
    observations = pair_observations(pairs, table.trajectory, center_sigma=per_axis)
    estimate = estimate_scale(observations, options=_scale_options(table))
    content = scale_json(observations, estimate, mean_radius=radius)
    content |= {
        "size_m": made.options.size_m,
        "gsd_m": made.options.gsd_m,
        "blur_cells": made.blur_cells,
        "per_pair": per_pair(pairs, left_out, observations, estimate),
        **_located(context, made),
    }
    if workspace.registration_path.is_file() and table.trajectory == "spc":
        content[_SHARED] = _shared_with_registration(workspace, made, estimate)
    return content, write_pairs(workspace, pairs)


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
