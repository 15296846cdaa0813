"""The result of either method of the scale stage, and the options of its estimate."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fusion.estimation.verdict import Code, Finding, Severity
from fusion.scaling.fit import ScaleOptions
from fusion.scaling.results import unobserved_json
from fusion.workspace.settings.processing import ScaleSettings


@dataclass
class ScaleResult:
    """Result of one method: content of ``scale.json``, findings, and files written.

    Attributes
    ----------
    content : dict
    findings : list of Finding
    files : tuple of Path
    registration_covariance : float, optional
        Covariance of ε with the scale of the registration; None if it is not known.
    """

    content: dict[str, Any]
    findings: list[Finding]
    files: tuple[Path, ...] = ()
    registration_covariance: float | None = None


def unobserved(method: str, trajectory: str, reason: str, **content: Any) -> ScaleResult:
    """Return the result if nothing is observed for a `reason`, with further `content`."""
    found = unobserved_json(method, trajectory, reason) | content
    return ScaleResult(found, [Finding(Code.SCALE_NOT_OBSERVED, Severity.REFUSED, reason)])


def scale_options(table: ScaleSettings) -> ScaleOptions:
    """Return the options of the estimate from the settings."""
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
