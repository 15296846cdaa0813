"""What each key of ``registration.json`` means; the reference of the documentation shows it.

A key within another one is written ``outer.inner``, also where `outer` is a list of entries.
"""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["REGISTRATION_KEYS"]
from typing import Any

REGISTRATION_KEYS: Mapping[str, str] = {
    "model": "`rigid` (6 parameters), `similarity` (7) or `affine` (12)",
    "by": "what was matched: `topography`, `returns`, `images` or `both`",
    "scale": "dimensionless; 1 for `rigid`; of an affine map the cube root of its determinant",
    "scale_sigma": "its sigma; 0 for `rigid`",
    "rotation_deg": "rotation vector (axis times angle) about the body-fixed axes",
    "rotation_sigma_deg": "sigmas of small rotations about body-fixed X, Y, Z",
    "translation_m": "where the origin of the lidar frame lies in SPC coordinates",
    "translation_sigma_m": "its sigmas",
    "parameters": "names of the parameters in the order of `covariance`, with units",
    "covariance": "of the parameters, in their units, rotations in radians",
    "matrix": "of an affine fit: V_spc = translation + matrix · V_lidar",
    "strain": "of an affine fit, shear and non-uniform scale: xx and yy less their mean, xy, xz, "
    "yz",
    "strain_sigma": "its sigmas",
    "residual_std_m": "standard deviation of the residuals of the mapolas used, for each "
    "body-fixed axis; errors of scans are not removed",
    "residual_mean_m": "mean residual; of a transform that was given",
    "n_used": "number of mapolas used",
    "n_rejected": "number of mapolas not used; those without a usable match are among them",
    "maplet_sigma_m": "estimated error of a maplet's centre, for each axis, beyond what matches "
    "and landmarks explain",
    "scan_sigma_m": "rms displacement of a mapola by errors of its scans, for each axis",
    "image_sigma_m": "by `images` and `both`: error of a place found in images, beyond its matches",
    "image_match_factor": "factor found on the sigmas of matches in images",
    "image_position_factor": "factor found on the sigmas of camera positions",
    "image_pointing_factor": "factor found on the sigmas of camera pointings",
    "n_images": "images used",
    "n_images_compared": "images searched for mapolas",
    "images_not_matched": "names of images in which no mapola was found",
    "types_rotation_deg": "rotation from the fit by heights alone to the fit by images alone",
    "types_rotation_sigma_deg": "its sigmas",
    "per_scan": "for each scan (or arc) what is added to its adjustment",
    "per_scan.scan": "name of the scan, `NAME:1`, `NAME:2`, … for its arcs",
    "per_scan.center_m": "point about which it is rotated",
    "per_scan.offset_m": "displacement",
    "per_scan.rotation_deg": "rotation vector",
    "per_scan_fit": "by `returns`: of each scan (or arc) alone the transform with its covariance "
    "about the origin; `offset_m` is where it puts the middle of the scan, less where the "
    "transform of the mission puts it; its sigma includes errors of maplets' centres; `reason` "
    "states why there is no fit",
    "blur_cells": "blur of SPC against lidar that was applied before matching, grid steps; "
    "negative: the lidar is the smoother one",
    "transfer": "what SPC keeps of the lidar's relief before the blur is applied: "
    "`wavenumber_per_cell`, `gain`, `coherence`",
    "noise_spectrum": "how the differences of the surfaces are spread over wavelengths: "
    "`wavenumber_per_cell`, `power` (relative); null if no match shows it",
    "landmarks": "errors of maplets' centres: number of `images`, of places `seen` in them, "
    "`pixel_sigma`, number of shared `patterns`, `offset_rms_m` taken out, `own_sigma_m` left; "
    'null with `[register] landmarks = "ignore"`',
    "per_mapola": "for each mapola:",
    "per_mapola.name": "its name",
    "per_mapola.center_m": "its centre in the lidar frame",
    "per_mapola.displacement_m": "displacement that takes it to the SPC surface",
    "per_mapola.sigma_m": "sigmas of the match alone",
    "per_mapola.scan_shift_m": "what the errors of its scans add to the transform: the mapola "
    "lies at T(V) + shift",
    "per_mapola.residual_m": "what the fit leaves",
    "per_mapola.scale_per_m": "change of the fitted scale for a displacement of this match, 1/m",
    "per_mapola.surface_residual_m": "SPC surface less registered lidar surface",
    "per_mapola.position_covariance_m2": "covariance of where the mapola is registered",
    "per_mapola.used": "whether it entered the fit",
    "per_mapola.reason": "why not, in words",
    "per_mapola.cause": "why not, as a code (`fusion.estimation.verdict.Cause`); null if used",
    "per_mapola.coverage": "share of the grid that both surfaces hold",
    "per_mapola.correlation": "of the two surfaces after the match, planes removed",
    "per_mapola.n_images": "by `images` and `both`: images in which it was found",
    "per_mapola.images_left_out": "reasons why others were left out, with their number",
    "per_mapola.types_chi2": "by `both`: place by heights against place by images, χ² with 3 "
    "degrees of freedom",
    "per_mapola.observation_types": "by `both`: displacement, sigma, residual, use, reason and "
    "correlation of each observation type",
    "tests": "`strain`: shear and non-uniform scale (lidar axes) with sigmas, z and χ² with 5 "
    "degrees of freedom; `scale`: scale − 1 with χ² of 1 degree; null with a `reason` where it "
    "cannot be observed",
    "stability": "`regions`: change of each parameter without a region, and the sigma expected of "
    "that change; `suspect_regions`; `bootstrap_sigma` and `formal_sigma`",
    "inverse": "the transform with its sigmas from SPC to lidar: V_lidar = translation + scale · "
    "R · V_spc",
    "applied": "of a transform that was given: file and direction",
    "iterations": "rounds of the fit",
    "converged": "whether it converged",
    "reason": "how the fit ended",
    "reasons": "parameters that are weakly determined or not separable",
    "verdict": "`accepted`, `doubtful` or `refused`",
    "findings": "why: `code`, `severity`, `text`, `value`, `limit` of each finding",
    "agreement": "whether the surfaces agree where the transform puts them: `mapolas_compared`, "
    "`share_with_common_relief`, `share_by_chance` (what unrelated ground reaches in the same "
    "search), `median_z_score` (standard deviations above unrelated ground), "
    "`residual_over_sigma` (height residuals in stated sigmas; null where none is stated)",
    "frame_search": "of a result that is not accepted: the frame in which the lidar would fit",
    "refused_estimate": "of a refused registration: what was fitted; the keys of the transform "
    "are null then",
    "made_by": "stage, version, settings and digests of the inputs",
}

OLD_KEYS: Mapping[str, str] = {
    "median_z_score": "median_clearness",
    "observation_types": "kinds",
    "types_chi2": "kinds_chi2",
    "types_rotation_deg": "kinds_rotation_deg",
    "types_rotation_sigma_deg": "kinds_rotation_sigma_deg",
    "changes": "kinds",
}
"""Old names of keys that were renamed; files have both until the next version."""


def with_old_keys(content: Any) -> Any:
    """Return JSON content in which each key that was renamed stands under its old name, too."""
    if isinstance(content, Mapping):
        known = {key: with_old_keys(value) for key, value in content.items()}
        return known | {OLD_KEYS[key]: value for key, value in known.items() if key in OLD_KEYS}
    if isinstance(content, list):
        return [with_old_keys(item) for item in content]
    return content
