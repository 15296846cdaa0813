"""The report of a workspace."""

from fusion.report.data import Coverage
from fusion.report.gather import PLANTED_FILE, gather_coverage, gather_report, places_of
from fusion.report.page import make_report
from fusion.report.recovered import Recovered, SurfaceErrors
from fusion.report.tables import number, planted_table, table

__all__ = [
    "PLANTED_FILE",
    "Coverage",
    "Recovered",
    "SurfaceErrors",
    "gather_coverage",
    "gather_report",
    "make_report",
    "number",
    "places_of",
    "planted_table",
    "table",
]
