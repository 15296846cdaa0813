"""Whole frames against the shape: rendering, orientation, offset and silhouette."""

from spcola.imagematching.frames.compare import FrameMatch, compare_frame, silhouette_overlap
from spcola.imagematching.frames.rendered import (
    CenterView,
    RenderedFrame,
    center_view,
    render_frame,
)

__all__ = [
    "CenterView",
    "FrameMatch",
    "RenderedFrame",
    "center_view",
    "compare_frame",
    "render_frame",
    "silhouette_overlap",
]
