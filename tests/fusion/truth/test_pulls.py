"""Statistics of pulls, of errors that are known to be right, too small or biased."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.report.planted import RecoveredParameter
from fusion.truth.pulls import pull_statistics

SIGMA = 2e-5


def missions(
    count: int, *, factor: float = 1.0, bias: float = 0.0
) -> list[list[RecoveredParameter]]:
    """Tables of one parameter whose errors have `factor` times the stated sigma."""
    errors = SIGMA * (factor * np.random.default_rng(7).normal(size=count) + bias)
    return [[RecoveredParameter("epsilon", 2.5e-4, 2.5e-4 + e, SIGMA, "")] for e in errors]


def test_true_sigmas_give_a_deviation_of_one() -> None:
    (found,) = pull_statistics(missions(4000))
    assert (found.count, found.missing) == (4000, 0)
    assert found.lowest < 1.0 < found.highest
    assert found.highest - found.lowest == pytest.approx(2 * 1.96 / np.sqrt(2 * 4000), rel=0.02)
    assert abs(found.mean) < 3 * found.mean_sigma
    assert found.error == pytest.approx(SIGMA * found.deviation)
    assert found.sigma == pytest.approx(SIGMA)


def test_sigmas_half_too_small_are_detected() -> None:
    (found,) = pull_statistics(missions(60, factor=2.0))
    assert found.lowest > 1.0


def test_a_bias_is_detected_and_raises_the_deviation() -> None:
    (found,) = pull_statistics(missions(400, bias=1.0))
    assert found.mean == pytest.approx(1.0, abs=3 * found.mean_sigma)
    assert found.deviation == pytest.approx(np.sqrt(2.0), rel=0.1)
    assert found.scatter == pytest.approx(1.0, rel=0.1)
    assert found.mean_sigma == pytest.approx(found.scatter / 20.0)


def test_the_interval_holds_one_in_95_of_100_trials() -> None:
    rng = np.random.default_rng(3)
    inside = 0
    for _ in range(400):
        rows = [[RecoveredParameter("x", 0.0, float(e), 1.0, "m")] for e in rng.normal(size=12)]
        (found,) = pull_statistics(rows)
        inside += found.lowest < 1.0 < found.highest
    assert inside / 400 == pytest.approx(0.95, abs=0.03)


def test_what_was_not_recovered_is_counted_not_averaged() -> None:
    lost = [RecoveredParameter("epsilon", 2.5e-4, float("nan"), float("nan"), "")]
    (found,) = pull_statistics([*missions(5), lost])
    assert (found.count, found.missing) == (5, 1)
    (none,) = pull_statistics([lost])
    assert none.count == 0
    assert np.isnan(none.deviation)


def test_few_large_errors_raise_the_kurtosis_and_not_the_deviation() -> None:
    """Sigmas that are right on average: a tenth of the missions errs by three times the rest."""
    rng = np.random.default_rng(5)
    size = np.where(rng.random(400) < 0.1, 3.0, 1.0) / np.sqrt(0.1 * 9.0 + 0.9)
    (heavy,) = pull_statistics(
        [[RecoveredParameter("x", 0.0, float(e), 1.0, "m")] for e in size * rng.normal(size=400)]
    )
    (normal,) = pull_statistics(missions(400))
    error = np.sqrt(24 / 400)
    assert heavy.lowest < 1.0 < heavy.highest
    assert heavy.kurtosis > 5 * error
    assert abs(normal.kurtosis) < 3 * error


def test_three_missions_have_no_kurtosis() -> None:
    (found,) = pull_statistics(missions(3))
    assert np.isnan(found.kurtosis)
