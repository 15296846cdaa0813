"""The surface of a synthetic body, sampled at some resolution."""

from __future__ import annotations

from dataclasses import replace

from spcola.truth.body import BodySettings, TruthBody
from spcola.truth.sampled import SampledSurface

SHADOW_SPACING = 1.0
"""Resolution of the surface that casts shadows and hides landmarks, metres."""


def ground_at(
    settings: BodySettings, spacing: float, *, memory_bytes: int = 2**30
) -> SampledSurface:
    """Return a body's surface, sampled at a spacing (metres), without rocks it would not resolve.

    Samples on single small rocks would represent all the surface around them.
    """
    rocks = settings.smallest_rock
    if rocks is not None:
        rocks = max(rocks, spacing) if spacing < settings.boulders.smallest else None
    body = TruthBody(replace(settings, smallest_rock=rocks))
    return SampledSurface(body, spacing, memory_bytes=memory_bytes)


def shadow_ground(settings: BodySettings) -> SampledSurface:
    """Return the surface that casts shadows."""
    return ground_at(settings, SHADOW_SPACING)
