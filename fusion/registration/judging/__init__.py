"""Acceptance tests of a registration: common relief, residuals against their stated sigmas."""

from fusion.registration.judging.common_ground import Placed, common_relief
from fusion.registration.judging.judging import Evidence, Limits, judge_registration, judge_relief

__all__ = ["Evidence", "Limits", "Placed", "common_relief", "judge_registration", "judge_relief"]
