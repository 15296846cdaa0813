"""The body sampled on a cube: rays, light and shadow."""

from spcola.truth.sampled.light import LightMap
from spcola.truth.sampled.sampled_surface import SampledSurface

__all__ = ["LightMap", "SampledSurface"]
