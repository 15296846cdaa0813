"""Figures of the report: coverage, registration, scale, sources."""

from fusion.report.figures.maps import draw_coverage, graticule, registration_figure
from fusion.report.figures.scale import scale_figure

__all__ = ["draw_coverage", "graticule", "registration_figure", "scale_figure"]
