"""Panels of figures that show maplets."""

from fusion.report.maplets.hillshade import hillshade, slope_deg
from fusion.report.maplets.panels import (
    bar_below,
    draw_differences,
    draw_sources,
    grid_image,
    label_panels,
    symmetric_limit,
)

__all__ = [
    "bar_below",
    "draw_differences",
    "draw_sources",
    "grid_image",
    "hillshade",
    "label_panels",
    "slope_deg",
    "symmetric_limit",
]
