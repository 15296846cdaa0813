"""The scale from paired bigmaps of all images."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from fusion.estimation import influence
from fusion.pipeline import StageContext
from fusion.scaling.fit import ScaleEstimate, estimate_scale
from fusion.scaling.judging import covariance_by_maplets, lost_findings, scale_findings
from fusion.scaling.pairs import pair_maplet_shares, pair_observations
from fusion.scaling.results import per_pair, scale_json, unused_pairs
from fusion.stages.scale.pairing import Pairing, pair_images, write_pairs
from fusion.stages.scale.result import ScaleResult, scale_options, unobserved
from fusion.workspace import Workspace
from fusion.workspace.settings.inputs import SpiceSettings
from fusion.workspace.settings.processing import ScaleSettings
from spcola.errors import NotObservableError
from spcola.shape import RayCaster


def scale_by_pairs(context: StageContext, caster: RayCaster, radius: float) -> ScaleResult:
    """Estimate the scale from paired bigmaps of all images.

    Parameters
    ----------
    context : StageContext
    caster : RayCaster
        Ray caster of the SPC shape.
    radius : float
        Mean radius of the body, metres.
    """
    workspace, table = context.workspace, context.table(ScaleSettings)
    made = pair_images(context, caster, radius)
    pairs, left_out = made.pairs, made.left_out
    files = tuple(write_pairs(workspace, pairs))
    if len(pairs) < 2:
        why = "; ".join(sorted({item.reason for item in left_out})) or "there are no images"
        found = unobserved(
            "pairs",
            table.trajectory,
            f"{len(pairs)} of {len(pairs) + len(left_out)} images give a pair ({why}); add scans "
            "taken with the images, or widen [scale] capture_m",
            per_pair=unused_pairs(left_out),
            **_located(context, made),
        )
        return replace(found, files=files)
    per_axis = np.sqrt(np.mean(made.center_sigma**2, axis=1))
    observations = pair_observations(pairs, table.trajectory, center_sigma=per_axis)
    options = scale_options(table)
    try:
        estimate = estimate_scale(observations, options=options)
    except NotObservableError as error:
        found = unobserved("pairs", table.trajectory, str(error), per_pair=unused_pairs(left_out))
        return replace(found, files=files)
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
    shared = None
    if workspace.registration_path.is_file() and table.trajectory == "spc":
        shared = _shared_with_registration(workspace, made, estimate)
    return ScaleResult(content, findings, files, shared)


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
