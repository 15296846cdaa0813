"""Whole frames against the shape: rendering, orientation, offset, silhouette, wrong states."""

from spcola.imagematching.frames.compare import FrameMatch, compare_frame
from spcola.imagematching.frames.mistakes import BodyOutline, Mistake, ViewProblem
from spcola.imagematching.frames.rendered import (
    CenterView,
    RenderedFrame,
    center_view,
    render_frame,
)

__all__ = [
    "BodyOutline",
    "CenterView",
    "FrameMatch",
    "Mistake",
    "RenderedFrame",
    "ViewProblem",
    "center_view",
    "compare_frame",
    "render_frame",
]
