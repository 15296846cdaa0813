"""Colours and formats of all figures."""

from fusion.report.style.style import (
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

__all__ = [
    "FUSED",
    "INK",
    "LIDAR",
    "MUTED",
    "REJECTED",
    "SPC",
    "data_uri",
    "drawing",
    "html_figure",
    "saved",
]
