"""The report of a workspace."""

from fusion.report.data import ReportData, Surfaces
from fusion.report.gather import fused_places, gather_coverage, gather_report
from fusion.report.page import make_report

__all__ = [
    "ReportData",
    "Surfaces",
    "fused_places",
    "gather_coverage",
    "gather_report",
    "make_report",
]
