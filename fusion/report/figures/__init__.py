"""Figures of the report: coverage, registration, scale, sources."""

from fusion.report.figures.maps import draw_coverage, graticule, registration_figure
from fusion.report.figures.scale import binned, scale_figure

__all__ = ["binned", "draw_coverage", "graticule", "registration_figure", "scale_figure"]
