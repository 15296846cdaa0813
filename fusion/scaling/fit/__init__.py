"""The joint estimate of scale, centre, rotation and range bias."""

from fusion.scaling.fit.joint import ScaleEstimate, ScaleOptions, estimate_scale
from fusion.scaling.fit.observation import TrajectorySource

__all__ = ["ScaleEstimate", "ScaleOptions", "TrajectorySource", "estimate_scale"]
