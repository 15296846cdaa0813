"""Scale: estimated from pairs or shots, and applied to a solution."""

from fusion.stages.scale.pairing import SampledPairs, sampled_pairs
from fusion.stages.scale.rescaling import AppliedScale, apply_scale
from fusion.stages.scale.shots import scale_by_shots, seconds_of_estimate, seconds_of_searches
from fusion.stages.scale.stage import STAGE

__all__ = [
    "STAGE",
    "AppliedScale",
    "SampledPairs",
    "apply_scale",
    "sampled_pairs",
    "scale_by_shots",
    "seconds_of_estimate",
    "seconds_of_searches",
]
