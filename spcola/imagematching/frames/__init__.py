"""Whole frames against the shape: rendering, orientation, offset, silhouette, state."""

from spcola.imagematching.frames.compare import FrameMatch, compare_frame, correlation_beyond
from spcola.imagematching.frames.rendered import (
    CenterView,
    RenderedFrame,
    View,
    center_view,
    footprint,
    render_frame,
)

__all__ = [
    "CenterView",
    "FrameMatch",
    "RenderedFrame",
    "View",
    "center_view",
    "compare_frame",
    "correlation_beyond",
    "footprint",
    "render_frame",
]
