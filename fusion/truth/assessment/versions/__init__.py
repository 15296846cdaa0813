"""Versions of a solution against the truth: how accuracy develops, and with what effort."""

from fusion.truth.assessment.versions.output import (
    versions_json,
    versions_lines,
    write_versions_page,
)
from fusion.truth.assessment.versions.versions import VersionScore, assess_versions

__all__ = [
    "VersionScore",
    "assess_versions",
    "versions_json",
    "versions_lines",
    "write_versions_page",
]
