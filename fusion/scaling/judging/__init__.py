"""Acceptance tests of a scale, and its agreement with the registration."""

from fusion.scaling.judging.agreement import consistency, covariance_by_maplets
from fusion.scaling.judging.findings import (
    consistency_findings,
    expected_scatter,
    lost_findings,
    place_findings,
    scale_findings,
    scan_findings,
)

__all__ = [
    "consistency",
    "consistency_findings",
    "covariance_by_maplets",
    "expected_scatter",
    "lost_findings",
    "place_findings",
    "scale_findings",
    "scan_findings",
]
