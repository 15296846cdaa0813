"""The report of a workspace."""

from fusion.report.data import Coverage
from fusion.report.gather import PLANTED_FILE, gather_coverage, gather_report, places_of
from fusion.report.maps import draw_coverage, graticule, registration_figure
from fusion.report.page import make_report
from fusion.report.recovered import Recovered, SurfaceErrors
from fusion.report.scale import PPM, scale_figure
from fusion.report.style import (
    FUSED,
    INK,
    LIDAR,
    MUTED,
    REJECTED,
    SPC,
    data_uri,
    drawing,
    html_figure,
    saved,
)
from fusion.report.surfaces import (
    MISSING,
    bar_below,
    draw_sources,
    grid_image,
    hillshade,
    label_axes,
    north_and_scale,
    symmetric_limit,
    write_statistics,
)
from fusion.report.tables import number, planted_table, table

__all__ = [
    "FUSED",
    "INK",
    "LIDAR",
    "MISSING",
    "MUTED",
    "PLANTED_FILE",
    "PPM",
    "REJECTED",
    "SPC",
    "Coverage",
    "Recovered",
    "SurfaceErrors",
    "bar_below",
    "data_uri",
    "draw_coverage",
    "draw_sources",
    "drawing",
    "gather_coverage",
    "gather_report",
    "graticule",
    "grid_image",
    "hillshade",
    "html_figure",
    "label_axes",
    "make_report",
    "north_and_scale",
    "number",
    "places_of",
    "planted_table",
    "registration_figure",
    "saved",
    "scale_figure",
    "symmetric_limit",
    "table",
    "write_statistics",
]
