"""The report of a workspace."""

from fusion.report.gather import fused_places, gather_coverage, gather_report
from fusion.report.page import make_report

__all__ = ["fused_places", "gather_coverage", "gather_report", "make_report"]
