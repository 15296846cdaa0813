"""What each key of ``scale.json`` means; the reference of the documentation shows it.

A key within another one is written ``outer.inner``, also where `outer` is a list of entries.
"""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["SCALE_KEYS"]

SCALE_KEYS: Mapping[str, str] = {
    "method": "`pairs` of bigmaps or single `shots`",
    "trajectory": "by whose spacecraft positions the returns were located: `spc` or `reference`. "
    "Without images it is the reference trajectory, or the kernels of `[spice]`, whatever the "
    "setting; `reasons` states this",
    "epsilon": "ε: all SPC lengths are to be multiplied by 1 + ε",
    "epsilon_sigma": "its sigma",
    "size_correction_m": "ε times the mean radius (of the settings, else of the shape)",
    "size_correction_sigma_m": "its sigma",
    "center_offset_m": "c: how far the lidar surface lies from SPC; with an independent "
    "trajectory it is minus the translation of the registration, to first order",
    "center_offset_sigma_m": "its sigmas",
    "prime_meridian_deg": "δθ about Z: a longitude in the SPC frame is that in the lidar frame "
    "plus this",
    "prime_meridian_sigma_deg": "its sigma",
    "pole_deg": "δθ about X and Y",
    "pole_sigma_deg": "its sigmas",
    "range_bias_m": "β > 0: measured ranges are too long by it, at any range",
    "range_bias_sigma_m": "its sigma",
    "parameters": "their order in `covariance`: epsilon, cx, cy, cz (m), rx, ry, rz (rad), range "
    "bias (m)",
    "covariance": "of the parameters",
    "single_sigma_m": "estimated error of one pair or shot",
    "state_sigma_m": "estimated error of an image's state, or of a scan; 0 where there is only "
    "one, or the setting is 0",
    "day_sigma_m": "estimated error that the ranges of a day share; 0 as for states",
    "ground_factor": "factor on the errors of the ground that observations share: stated by "
    "maplets (pairs), shown by residuals (shots)",
    "ground_sigma_m": "shots: error of heights that near shots share; null where none is found",
    "ground_reach_m": "shots: distance at which that error is correlated by 1/e",
    "residuals": "as range differences: `measured_minus_predicted` before the fit, `after_fit` "
    "what its parameters leave; each with `mean_m`, `std_m`, `median_m` and `robust_std_m` "
    "(1.4826 × median absolute deviation)",
    "n_used": "pairs or shots used",
    "n_rejected": "pairs or shots not used; images without a pair and shots that have no place "
    "are in neither number",
    "per_day": "for each UTC date:",
    "per_day.day": "the date",
    "per_day.n": "number of pairs or shots",
    "per_day.epsilon": "ε of the day alone; estimated rotation and range bias are taken out, the "
    "offset of the centre is not",
    "per_day.epsilon_sigma": "from errors of single observations and shared states, not the day's "
    "own error",
    "per_day.size_correction_m": "as above",
    "per_day.mean_epsilon": "mean of the pairs as if all were independent, as published",
    "per_day.standard_error": "of that mean",
    "per_pair": "for each image (without a pair only `image`, `used`, `reason` and `cause`):",
    "per_pair.image": "its name",
    "per_pair.day": "UTC date",
    "per_pair.epsilon": "ε of the pair alone",
    "per_pair.epsilon_sigma": "of the match alone",
    "per_pair.range_m": "from the mean spacecraft position of the returns to the centre of the "
    "bigmap",
    "per_pair.dx_m": "lidar less SPC along Ux of the bigmap, south",
    "per_pair.dy_m": "along Uy, east",
    "per_pair.dz_m": "along Uz, up",
    "per_pair.residual_m": "body-fixed, shared errors removed",
    "per_pair.correlation": "of the two bigmaps",
    "per_pair.coverage": "share of the grid that both cover",
    "per_pair.longitude_deg": "east",
    "per_pair.local_time_h": "local solar time",
    "per_pair.emission_deg": "angle between the ground's normal and the image",
    "per_pair.incidence_deg": "angle between the ground's normal and the Sun",
    "per_pair.used": "whether it entered the fit",
    "per_pair.reason": "why not, in words",
    "per_pair.cause": "why not, as a code (`fusion.estimation.verdict.Cause`); null if used",
    "per_shot": "for each shot:",
    "per_shot.scan": "name of its scan",
    "per_shot.day": "UTC date",
    "per_shot.epsilon": "ε of the shot alone",
    "per_shot.range_m": "predicted",
    "per_shot.residual_m": "measured less predicted, by the facet that the beam meets from where "
    "the estimate puts it",
    "per_shot.fitted_residual_m": "what the eight parameters leave; shared errors are not removed",
    "per_shot.sigma_m": "of the range",
    "per_shot.longitude_deg": "east",
    "per_shot.used": "whether it entered the fit",
    "trends": "ε = mean + a cos φ + b sin φ over `longitude` and, where it is known, "
    "`local_time`: `amplitude`, `sigma`, `phase_rad` of the largest ε, `p_value`",
    "registration_consistency": "`difference` = (1 + ε) · scale − 1 with `difference_sigma`, `z`, "
    "the two-sided `p_value`, the joint `covariance` of ε and scale, and `sigma_is`: `joint`, or "
    "`bound` where their common errors are not known; with a joint covariance `epsilon_of_both` "
    "and `epsilon_of_both_sigma`, the mean of ε and 1/scale − 1 of least variance",
    "reasons": "which terms the data do not determine or separate, and why",
    "converged": "whether the fit converged",
    "reason": "how it ended",
    "verdict": "`accepted`, `doubtful` or `refused`",
    "findings": "why: `code`, `severity`, `text`, `value`, `limit` of each finding",
    "located_within_m": "where returns were located again by kernels or images: by how much "
    "interpolation may displace them; 0 where kernels were read at each time",
    "size_m": "pairs: side of the bigmaps",
    "gsd_m": "pairs: their ground sample distance",
    "blur_cells": "pairs: as in `registration.json`",
    "returns_without_place": "pairs: returns without a place, by scan",
    "assumed": "shots: `footprint_mrad`, `pointing_sigma_mrad` (null: not known), `range_sigma_m`",
    "n_shots": "shots: how many were taken, thinned to `max_shots`: the sum of `n_used`, "
    "`n_rejected`, `missed`, `outside_kernels`, `outside_trajectory` and `no_time`",
    "missed": "shots that miss the shape, graze it, or have no spacecraft position",
    "outside_kernels": "shots at times outside the kernels of `[spice]`, or in a gap longer than "
    "`max_gap_s`",
    "outside_trajectory": "shots at times outside the states of the images, or without a "
    "trajectory",
    "no_time": "shots without a time",
    "spans": "shots with kernels: `kernels_utc` (first and last time), `kernels_windows` (spans "
    "without a longer gap), `shots_utc`",
    "longitude_check": "shots: whether all fit better turned or mirrored. `statistic`, `n_shots` "
    "compared, `scatter_here_m`, `scatter_best_m`, `best` in words, `best_turn_deg` (null if it "
    "is no turn about Z), `p_value` over all `places_tried` (the larger of `p_paired` and "
    "`p_noise`), `n_independent` shots, `misfit`; `scatter_wrong_m` is the median at "
    "`wrong_places`, `rivals` how many of these fit as well",
    "scan_check": "shots: whether single scans fit better elsewhere, and whether scans agree. "
    "`per_scan`: `scans`, `n_shots`, `scatter_here_m`, `scatter_best_m`, `best`, `p_value`, "
    "`misfit`. `within_m` and `between_m`: difference of neighbouring shots of one scan and of "
    "different scans over √2 (null: fewer than 100), `neighbours`, `neighbours_apart_m`",
    "made_by": "stage, version, settings and digests of the inputs",
}
