"""The assessment as JSON (``assess --json``), and as lines of text."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import numpy as np

from fusion.truth.assessment.assessment import Assessment
from fusion.truth.assessment.definitions import definitions
from fusion.truth.assessment.formal import FormalUncertainty
from fusion.truth.assessment.regions import RegionScore
from fusion.truth.assessment.resolution import Transfer
from fusion.truth.assessment.rigid import RigidFit
from fusion.truth.assessment.score import ModelScore


def assessment_json(found: Assessment) -> dict[str, Any]:
    """Return the content of ``assess --json``; units are in the keys, NaN means unknown."""
    formal = found.formal
    return {
        "definitions": definitions(found.settings),
        "settings": asdict(found.settings),
        "seed": found.planted.settings.seed,
        "formal_uncertainty": None if formal is None else formal_json(formal),
        "models": [model_json(score, formal) for score in found.models],
        "recovered": [{**asdict(row), "pull": row.pull} for row in found.recovered],
    }


def formu_ratio(score: ModelScore, formal: FormalUncertainty | None) -> float:
    """Return FormU over the optimised 3D rms; NaN if either is unknown."""
    rms = score.distances.rms_optimised
    return float("nan") if formal is None or not rms > 0 else formal.formu / rms


def assessment_lines(found: Assessment) -> Iterator[str]:
    """Yield the lines of a table of models, then FormU and the recovered parameters."""
    yield (
        f"{'':26}{'3D rms':>9}{'no offset':>10}{'optimised':>10}{'height rms':>11}"
        f"{'lit':>8}{'shadowed':>9}{'slope':>8}{'resolved':>9}{'pull':>7}{'1 σ':>6}{'2 σ':>6}"
    )
    for score in found.models:
        d, by = score.distances, {region.region: region for region in score.regions}
        whole = by["all"]
        cells = (
            _cell(d.rms, 9), _cell(d.rms_without_offset, 10), _cell(d.rms_optimised, 10),
            _cell(whole.rms, 11), _cell(by["lit"].rms, 8), _cell(by["shadowed"].rms, 9),
            _cell(whole.slope_rms_deg, 8, "{:.1f}°"), _cell(score.transfer.half_power, 9, "{:.2f}"),
            _cell(whole.pull_std, 7, "{:.2f}"), _cell(whole.within_1, 6, "{:.2f}"),
            _cell(whole.within_2, 6, "{:.2f}"),
        )  # fmt: skip
        yield f"{score.name[:25]:26}{''.join(cells)}"
    yield "lengths in metres; --json has definitions of all columns"
    if found.formal is not None:
        formal = found.formal
        yield (
            f"FormU {formal.formu:.3f} m ({formal.maplets} maplets at {formal.gsd:g} m, "
            f"{formal.observations} observations, {formal.residual_pixels:.2f} pixels)"
        )
    for row in found.recovered:
        mark = "" if np.isnan(row.pull) else f"{row.pull:+.1f} σ"
        unit = f" {row.unit}" if row.unit else ""
        yield (
            f"{row.name}: planted {row.planted:.6g}, recovered {_plain(row.recovered)} "
            f"± {_plain(row.sigma)}{unit} {mark}".rstrip()
        )


def _cell(value: float, width: int, form: str = "{:.3f}") -> str:
    return f"{'–' if np.isnan(value) else form.format(value):>{width}}"


def _plain(value: float) -> str:
    return "unknown" if np.isnan(value) else f"{value:.6g}"


def formal_json(formal: FormalUncertainty) -> dict[str, Any]:
    """Return FormU in JSON types."""
    return {
        "formu_m": formal.formu,
        "formu_share_80_m": formal.share_80,
        "residual_pixels": formal.residual_pixels,
        "gsd_m": formal.gsd,
        "maplets": formal.maplets,
        "observations": formal.observations,
    }


def model_json(score: ModelScore, formal: FormalUncertainty | None) -> dict[str, Any]:
    """Return the numbers of one model in JSON types."""
    d = score.distances
    return {
        "name": score.name,
        "frame": score.frame,
        "gsd_m": score.gsd,
        "patches_compared": score.patches,
        "patches_there": score.patches_there,
        "vertices": d.count,
        "rms_3d_m": d.rms,
        "rms_3d_without_offset_m": d.rms_without_offset,
        "rms_3d_optimised_m": d.rms_optimised,
        "mean_distance_m": d.mean,
        "largest_distance_m": d.largest,
        "center_offset_m": -d.translation.translation,
        "center_offset_sigma_m": _sigmas(d.translation)[:3],
        "center_of_figure_offset_m": d.center_of_figure,
        "optimised_translation_m": d.rigid.translation,
        "optimised_translation_sigma_m": _sigmas(d.rigid)[:3],
        "optimised_rotation_deg": np.degrees(d.rigid.rotation),
        "optimised_rotation_sigma_deg": np.degrees(_sigmas(d.rigid)[3:]),
        "icp": _icp(d.rigid),
        "formu_ratio": formu_ratio(score, formal),
        **_resolution(score.transfer),
        "regions": {region.region: _region(region) for region in score.regions},
    }


def _sigmas(fit: RigidFit) -> Any:
    return np.sqrt(np.diag(fit.covariance))


def _icp(fit: RigidFit) -> dict[str, Any]:
    return {
        "iterations": fit.iterations,
        "converged": fit.converged,
        "reason": fit.reason,
        "vertices": fit.count,
        "covariance": fit.covariance,
    }


def _resolution(transfer: Transfer) -> dict[str, Any]:
    return {
        "resolution_m": transfer.half_power,
        "resolution_reason": transfer.reason,
        "coherent_resolution_m": transfer.half_coherence,
        "spectra": {
            "wavelength_m": transfer.wavelength,
            "transfer": transfer.transfer,
            "coherence": transfer.coherence,
            "power_ratio": transfer.power_ratio,
            "windows": transfer.windows,
        },
    }


def _region(region: RegionScore) -> dict[str, Any]:
    return {
        "points": region.count,
        "mean_m": region.mean,
        "rms_m": region.rms,
        "robust_std_m": region.robust,
        "largest_m": region.largest,
        "slope_rms_deg": region.slope_rms_deg,
        "sigma_rms_m": region.sigma_rms,
        "pull_mean": region.pull_mean,
        "pull_std": region.pull_std,
        "within_1_sigma": region.within_1,
        "within_2_sigma": region.within_2,
    }
