"""The body sampled on a cube: rays, light and shadow."""

from spcola.truth.sampled.light import LightMap, ShadowedSurface
from spcola.truth.sampled.sampled_surface import SampledSurface

__all__ = ["LightMap", "SampledSurface", "ShadowedSurface"]
