from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fusion.estimation.verdict import Cause, Code, Severity, Verdict
from fusion.scaling.fit import ScaleOptions, estimate_scale
from fusion.scaling.fit.observation import ScaleObservations
from fusion.scaling.fit.residuals import residuals_json
from fusion.scaling.judging import (
    consistency_findings,
    lost_findings,
    scale_findings,
)

DAYS = ("2019-03-07", "2019-03-14", "2019-03-21")
# By an independent trajectory rotations and centre are determined by the relief of one body only.
OPTIONS = ScaleOptions()


def compared(
    seed,
    *,
    kind="pairs",
    trajectory="spc",
    count=45,
    epsilon=2e-4,
    center=(0.0, 0.0, 0.0),
    turn_deg=(0.0, 0.0, 0.0),
    noise=0.1,
    day_m=(0.0, 0.0, 0.0),
    wrong=0.0,
):
    """Lidar minus SPC on a globe of 245 m; a share `wrong` of the comparisons is metres off."""
    generator = np.random.default_rng(seed)
    normal = generator.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    slope = normal + 0.3 * generator.normal(size=normal.shape)
    slope /= np.linalg.norm(slope, axis=1, keepdims=True)
    beam, distance = -normal, generator.uniform(3000.0, 7000.0, count)
    point = 245.0 * normal
    day = np.arange(count) % len(DAYS)
    arm = distance[:, None] * beam if trajectory == "spc" else point
    shift = epsilon * arm + np.array(center) - np.cross(np.radians(turn_deg), arm)
    shift += np.array(day_m)[day, None] * beam + noise * generator.normal(size=shift.shape)
    off = np.arange(count) < wrong * count
    shift[off] += 30.0 * generator.normal(size=(int(off.sum()), 3))
    covariance = np.broadcast_to(1e-4 * np.eye(3), (count, 3, 3))
    if kind == "shots":
        shift = (np.sum(slope * shift, axis=1) / np.sum(slope * beam, axis=1))[:, None]
        covariance = np.full((count, 1, 1), 1e-4)
    return ScaleObservations(
        kind=kind,
        label=tuple(f"I{n}" for n in range(count)),
        day=tuple(DAYS[k] for k in day),
        value=shift,
        covariance=covariance,
        point=point,
        beam=beam,
        range=distance,
        normal=slope,
        local_time_h=np.full(count, np.nan),
        shares=np.ones((count, 1)),
        trajectory=trajectory,
    )


def found(observations, options=OPTIONS):
    """Codes that make a scale doubtful."""
    findings = scale_findings(observations, estimate_scale(observations, options=options), options)
    return {one.code for one in findings if one.severity is not Severity.NOTE}


@pytest.mark.parametrize("kind", ["pairs", "shots"])
@pytest.mark.parametrize("trajectory", ["spc", "reference"])
def test_right_data_are_accepted(kind, trajectory):
    for seed in range(10):
        data = compared(seed, kind=kind, trajectory=trajectory, day_m=(0.02, -0.02, 0.01))
        assert found(data) == set()


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"epsilon": 0.06}, Code.EPSILON_BEYOND_PRIOR),
        ({"center": (0.0, -45.0, 0.0)}, Code.CENTRE_BEYOND_PRIOR),
        ({"turn_deg": (0.5, 0.0, 0.0)}, Code.POLE_BEYOND_PRIOR),
        ({"turn_deg": (0.0, 0.0, 5.0)}, Code.MERIDIAN_BEYOND_PRIOR),
        ({"wrong": 0.3}, Code.SCATTER_TOO_LARGE),
        ({"noise": 15.0}, Code.SCATTER_TOO_LARGE),
        ({"day_m": (0.0, 0.0, 1.5)}, Code.DAYS_DISAGREE),
    ],
)
@pytest.mark.parametrize("kind", ["pairs", "shots"])
def test_what_makes_the_number_wrong_is_doubtful(kind, change, code):
    assert code in found(compared(3, kind=kind, **change))


def test_many_that_disagree_with_the_rest_are_doubtful():
    data = compared(3)
    estimate = estimate_scale(data)
    for share, doubtful in ((0.1, False), (0.3, True)):
        weight = np.where(np.arange(len(data)) < share * len(data), 0.0, 1.0)
        fit = replace(estimate.fit, weight=weight)
        findings = scale_findings(data, replace(estimate, fit=fit), OPTIONS)
        assert (Code.MANY_REJECTED in {one.code for one in findings}) == doubtful


def test_a_fit_that_still_moves_is_doubtful_and_one_that_hops_is_not():
    data = compared(1)
    estimate = estimate_scale(data)
    for moved, severity in ((2.0, Severity.DOUBTFUL), (0.01, Severity.NOTE)):
        fit = replace(estimate.fit, converged=False, moved=moved)
        findings = scale_findings(data, replace(estimate, fit=fit), OPTIONS)
        said = [one.severity for one in findings if one.code is Code.SCALE_NOT_CONVERGED]
        assert said == [severity]


def test_a_weak_epsilon_is_a_note():
    data = compared(2, epsilon=0.0, noise=0.3)
    findings = scale_findings(data, estimate_scale(data), OPTIONS)
    assert Verdict(tuple(findings)).judgement == "accepted"
    assert Code.EPSILON_NOT_SIGNIFICANT in {one.code for one in findings}


def test_scales_that_disagree_are_doubtful():
    good = {"p_value": 0.02, "difference": 1e-4, "z": 2.3}
    assert consistency_findings(good) == []
    assert consistency_findings({**good, "p_value": None}) == []
    (bad,) = consistency_findings({**good, "p_value": 1e-6, "z": -4.9})
    assert (bad.code, bad.severity) == (Code.SCALES_INCONSISTENT, Severity.DOUBTFUL)


def test_shares_of_what_is_missing():
    assert lost_findings("shots", 30, 100) == []
    assert lost_findings("shots", 40, 100)[0].code is Code.SHOTS_MISS_SHAPE
    assert lost_findings("pairs", 2, 24) == []
    assert lost_findings("pairs", 23, 24)[0].code is Code.PAIRS_NOT_MATCHED


@pytest.mark.parametrize("kind", ["pairs", "shots"])
def test_mean_and_scatter_of_residuals(kind):
    # An independent trajectory: a body that is larger by 1 % has ranges shorter by 2.45 m.
    data = compared(1, kind=kind, trajectory="reference", epsilon=0.01, noise=0.05, count=200)
    content = residuals_json(data, estimate_scale(data).fit)
    before, after = content["measured_minus_predicted"], content["after_fit"]
    assert before["mean_m"] == pytest.approx(-2.45, abs=0.05)
    assert before["median_m"] == pytest.approx(-2.45, abs=0.05)
    assert abs(after["mean_m"]) < 0.02
    assert after["std_m"] == pytest.approx(0.05, rel=0.3)
    assert after["robust_std_m"] == pytest.approx(0.05, rel=0.3)


def test_every_code_has_a_meaning():
    assert all(one.meaning and one == one.value for kind in (Code, Cause) for one in kind)
