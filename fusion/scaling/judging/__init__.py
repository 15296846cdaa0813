"""Acceptance tests of a scale, and its agreement with the registration."""

from fusion.scaling.judging.agreement import consistency, shared_by_maplets
from fusion.scaling.judging.findings import (
    consistency_findings,
    expected_scatter,
    missed_findings,
    place_findings,
    scale_findings,
    scan_findings,
    unmatched_findings,
    unobserved_findings,
)

__all__ = [
    "consistency",
    "consistency_findings",
    "expected_scatter",
    "missed_findings",
    "place_findings",
    "scale_findings",
    "scan_findings",
    "shared_by_maplets",
    "unmatched_findings",
    "unobserved_findings",
]
