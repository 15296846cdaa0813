from .light import LightMap as LightMap
from .sampled_surface import SampledSurface as SampledSurface
