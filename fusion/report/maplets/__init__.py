"""Figures of one place: hillshades, differences, sources."""

from fusion.report.maplets.surfaces import (
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

__all__ = [
    "MISSING",
    "bar_below",
    "draw_sources",
    "grid_image",
    "hillshade",
    "label_axes",
    "north_and_scale",
    "symmetric_limit",
    "write_statistics",
]
