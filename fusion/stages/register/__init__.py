"""Registration of mapolas to the SPC surface."""

from fusion.stages.register.imaging import ImageScene
from fusion.stages.register.matching import Matcher
from fusion.stages.register.stage import STAGE

__all__ = ["STAGE", "ImageScene", "Matcher"]
