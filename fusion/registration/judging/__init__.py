"""Acceptance tests of a registration: common relief, residuals against their stated sigmas."""

from fusion.registration.judging.common_ground import UNRELATED, ReliefPair, common_relief
from fusion.registration.judging.judging import (
    Evidence,
    RegistrationLimits,
    judge_registration,
    judge_relief,
)

__all__ = [
    "UNRELATED",
    "Evidence",
    "RegistrationLimits",
    "ReliefPair",
    "common_relief",
    "judge_registration",
    "judge_relief",
]
