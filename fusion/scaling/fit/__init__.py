"""The joint estimate of scale, centre, rotation and range bias."""

from fusion.scaling.fit.joint import ScaleEstimate, ScaleOptions, estimate_scale
from fusion.scaling.fit.observation import Trajectory

__all__ = ["ScaleEstimate", "ScaleOptions", "Trajectory", "estimate_scale"]
