"""The ground of a synthetic body as it is seen at some resolution, sampled."""

from __future__ import annotations

from dataclasses import replace

from spcola.truth.body import BodySettings, TruthBody
from spcola.truth.sampled import SampledSurface

SHADOW_SPACING = 1.0
"""What casts shadows, and stands before landmarks, is resolved to this, metres."""


def ground_at(
    settings: BodySettings, spacing: float, *, memory_bytes: int = 2**30
) -> SampledSurface:
    """Return a body's surface, sampled at a spacing, without the rocks that it would not resolve.

    Samples that fall on single rocks would stand for all the ground around them.
    """
    rocks = settings.smallest_rock
    if rocks is not None:
        rocks = max(rocks, spacing) if spacing < settings.boulders.smallest else None
    body = TruthBody(replace(settings, smallest_rock=rocks))
    return SampledSurface(body, spacing, memory_bytes=memory_bytes)


def shadow_ground(settings: BodySettings) -> SampledSurface:
    """Return the surface that tells light from shadow."""
    return ground_at(settings, SHADOW_SPACING)
