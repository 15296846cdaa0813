"""The verdict on a registration by its numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fusion.estimation.verdict import Code
from fusion.registration.judging import Evidence, RegistrationLimits, judge_registration
from fusion.registration.judging.common_ground import CommonRelief

LIMITS = RegistrationLimits(rotation_deg=1.0, scale=0.01, center_sigma_m=0.05)


def content(**changed: Any) -> dict[str, Any]:
    """A registration with nothing against it."""
    return {
        "scale": 1.0005,
        "scale_sigma": 1e-4,
        "rotation_deg": [0.01, 0.0, -0.02],
        "rotation_sigma_deg": [0.005] * 3,
        "n_used": 22,
        "n_rejected": 2,
        "maplet_sigma_m": 0.04,
        "landmarks": {"own_sigma_m": 0.03},
        "tests": {"strain": {"p_value": 0.2, "strain": [0.0] * 5}},
        "converged": True,
        "reason": "weights settled",
        **changed,
    }


def evidence(shown: int = 24, chi: float = 0.9) -> Evidence:
    z_score = np.where(np.arange(24) < shown, 9.0, 1.5)
    return Evidence(CommonRelief(z_score, np.zeros(24), 0.001), np.full(24, chi))


def images(matched: int, of: int = 24) -> dict[str, Any]:
    """Numbers of images that match, and of images compared."""
    missing = [f"P{number:02d}" for number in range(matched, of)]
    return {"n_images": matched, "n_images_compared": of, "images_not_matched": missing}


def disagreement(middle: float) -> dict[str, Any]:
    """Mapolas of which images and heights differ by a median χ² of 3 degrees of freedom."""
    return {"per_mapola": [{"types_chi2": middle * (0.5 + k / 12)} for k in range(13)] + [
        {"types_chi2": np.nan}, {}
    ]}  # fmt: skip


def turned(sigmas: float) -> dict[str, Any]:
    """Rotation by images against that by heights, standard deviations."""
    turn = np.array([0.01, 0.02 * sigmas, 0.0])
    return {"types_rotation_deg": turn, "types_rotation_sigma_deg": np.full(3, 0.02)}


def codes(judged: dict[str, Any], seen: Evidence) -> tuple[str, list[str]]:
    verdict = judge_registration(judged, seen, LIMITS)
    return verdict.judgement, [str(found.code) for found in verdict.findings]


def test_a_sound_registration_is_accepted() -> None:
    assert codes(content(), evidence()) == ("accepted", [])


def test_images_that_match_and_agree_with_the_heights_are_accepted() -> None:
    assert codes(content(**images(22), **disagreement(4.5), **turned(3.0)), evidence()) == (
        "accepted",
        [],
    )


@pytest.mark.parametrize(
    ("judged", "seen", "judgement", "code"),
    [
        (content(), evidence(shown=11), "doubtful", Code.RELIEF_UNRELATED),
        (content(), evidence(shown=3), "refused", Code.RELIEF_UNRELATED),
        (content(n_used=10, n_rejected=14), evidence(), "doubtful", Code.FEW_AGREE),
        (content(n_used=4, n_rejected=20), evidence(), "refused", Code.FEW_AGREE),
        (content(**images(17)), evidence(), "doubtful", Code.IMAGES_NOT_MATCHED),
        (content(**images(0)), evidence(), "doubtful", Code.IMAGES_NOT_MATCHED),
        (content(**images(0, of=0)), evidence(), "doubtful", Code.IMAGES_NOT_MATCHED),
        (content(**disagreement(12.0)), evidence(), "doubtful", Code.IMAGES_DISAGREE),
        (content(**disagreement(45.0)), evidence(), "refused", Code.IMAGES_DISAGREE),
        (content(**turned(6.0)), evidence(), "doubtful", Code.IMAGES_DISAGREE),
        (content(**turned(-30.0)), evidence(), "refused", Code.IMAGES_DISAGREE),
        (content(), evidence(chi=2.0), "doubtful", Code.HEIGHTS_DISAGREE),
        (content(), evidence(chi=5.0), "refused", Code.HEIGHTS_DISAGREE),
        (content(maplet_sigma_m=0.17), evidence(), "doubtful", Code.CENTERS_DISAGREE),
        (content(maplet_sigma_m=0.6), evidence(), "refused", Code.CENTERS_DISAGREE),
        (content(scale=0.985), evidence(), "doubtful", Code.LARGE_SCALE),
        (content(scale=1.342, scale_sigma=0.007), evidence(), "refused", Code.LARGE_SCALE),
        (content(rotation_deg=[0.0, 2.9, 0.0]), evidence(), "doubtful", Code.LARGE_ROTATION),
        (content(converged=False), evidence(), "doubtful", Code.NOT_CONVERGED),
    ],
)
def test_each_sign_of_a_wrong_registration_has_its_code(
    judged: dict[str, Any], seen: Evidence, judgement: str, code: Code
) -> None:
    assert codes(judged, seen) == (judgement, [code])


def test_an_uncertain_scale_or_rotation_is_not_called_large() -> None:
    weak = content(scale=1.02, scale_sigma=0.005, rotation_deg=[2.0, 0, 0])
    weak["rotation_sigma_deg"] = [0.5] * 3
    assert codes(weak, evidence()) == ("accepted", [])


def test_strain_beyond_chance_is_doubtful() -> None:
    strained = content(tests={"strain": {"p_value": 1e-9, "strain": [0.002, 0, 0, 0, 0]}})
    assert codes(strained, evidence()) == ("doubtful", [Code.STRAIN])


def test_what_is_not_known_is_not_tested() -> None:
    """A transform that was given has no error sizes and no tests; no file states a sigma."""
    given = content(maplet_sigma_m=None, landmarks=None, tests=None)
    assert codes(given, evidence(chi=float("nan"))) == ("accepted", [])


def test_ground_without_relief_is_doubtful() -> None:
    bare = Evidence(CommonRelief(np.full(24, np.nan), np.zeros(24), 0.0), np.full(24, 1.0))
    assert codes(content(), bare) == ("doubtful", [Code.NO_RELIEF])


def test_what_is_weakly_determined_is_a_note_with_a_code() -> None:
    verdict = judge_registration(content(reasons=["tx_m: weakly determined"]), evidence(), LIMITS)
    assert verdict.judgement == "accepted"
    assert [(found.code, found.text) for found in verdict.findings] == [
        (Code.WEAKLY_DETERMINED, "tx_m: weakly determined")
    ]


def test_the_gravest_finding_comes_first() -> None:
    judgement, found = codes(content(rotation_deg=[0, 0, 5.0]), evidence(shown=0, chi=2.0))
    assert judgement == "refused"
    assert found[0] == Code.RELIEF_UNRELATED
