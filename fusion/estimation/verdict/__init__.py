"""Verdicts on results: accepted, doubtful, refused, with coded reasons."""

from fusion.estimation.verdict.verdict import (
    JUDGEMENTS,
    Cause,
    Code,
    Finding,
    Severity,
    Verdict,
    verdict_lines,
)

__all__ = ["JUDGEMENTS", "Cause", "Code", "Finding", "Severity", "Verdict", "verdict_lines"]
