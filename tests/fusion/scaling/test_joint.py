from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kurtosis

from fusion.estimation import influence
from fusion.scaling.fit import ScaleOptions, estimate_scale
from fusion.scaling.fit.observation import PARAMETERS, ScaleObservations
from fusion.scaling.judging import consistency
from fusion.scaling.results import scale_json, unobserved_json
from spcola.errors import InvalidValueError, NotObservableError

DAYS = ("2019-03-07", "2019-03-14", "2019-03-21", "2019-03-28", "2019-04-04")


def mission(
    generator,
    *,
    count=60,
    kind="pairs",
    trajectory="spc",
    epsilon=2e-4,
    center=(0.0, 0.0, 0.0),
    turn_deg=(0.0, 0.0, 0.0),
    bias=0.0,
    noise=0.2,
    day_noise=0.0,
    ranges=(3000.0, 7000.0),
    longitudes=(0.0, 2 * np.pi),
    shares=None,
    state_noise=0.0,
):
    """Lidar minus SPC on a body of 245 m, built vector by vector, not by the design matrix."""
    longitude = generator.uniform(*longitudes, count)
    latitude = np.arcsin(generator.uniform(-0.95, 0.95, count))
    normal = np.stack(
        [
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        ],
        axis=1,
    )
    point = 245.0 * normal
    away = normal + 0.3 * generator.normal(size=normal.shape)
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    beam, distance = -away, generator.uniform(*ranges, count)
    day = tuple(DAYS[index % len(DAYS)] for index in range(count))
    arm = distance[:, None] * beam if trajectory == "spc" else point
    shift = epsilon * arm + np.array(center) - np.cross(np.radians(turn_deg), arm) + bias * beam
    own = {name: day_noise * generator.normal() for name in DAYS}
    shift = shift + np.array([own[name] for name in day])[:, None] * beam
    shift = shift + noise * generator.normal(size=shift.shape)
    if shares is not None:
        shift = shift + state_noise * shares @ generator.normal(size=(shares.shape[1], 3))
    covariance = np.broadcast_to(1e-4 * np.eye(3), (count, 3, 3))
    if kind == "shots":
        shift = (np.sum(normal * shift, axis=1) / np.sum(normal * beam, axis=1))[:, None]
        covariance = np.full((count, 1, 1), 1e-4)
    return ScaleObservations(
        kind=kind,
        label=tuple(f"I{n}" for n in range(count)),
        day=day,
        value=shift,
        covariance=covariance,
        point=point,
        beam=beam,
        range=distance,
        normal=normal,
        local_time_h=generator.uniform(0, 24, count),
        shares=np.ones((count, 1)) if shares is None else shares,
        trajectory=trajectory,
    )


@pytest.mark.parametrize("kind", ["pairs", "shots"])
@pytest.mark.parametrize("trajectory", ["spc", "reference"])
def test_all_planted_terms_are_recovered_without_noise(kind, trajectory):
    data = mission(
        np.random.default_rng(1),
        count=200,
        kind=kind,
        trajectory=trajectory,
        epsilon=3e-4,
        center=(0.1, -0.2, 0.05),
        turn_deg=(0.004, -0.003, 0.011),
        bias=0.02,
        noise=0.0,
    )
    estimate = estimate_scale(
        data, options=ScaleOptions(single_sigma_m=1e-6, day_sigma_m=0.0, range_bias_prior_m=1.0)
    )
    truth = [3e-4, 0.1, -0.2, 0.05, *np.radians([0.004, -0.003, 0.011]), 0.02]
    unit = [1e-8, 1e-5, 1e-5, 1e-5, 1e-8, 1e-8, 1e-8, 1e-5]
    # The uncertainty that is claimed (1 cm each) holds the prior's pull below this.
    assert np.all(np.abs(estimate.fit.estimate - truth) < 0.1 * estimate.fit.sigma + unit)


def test_pulls_are_of_unit_width_with_biased_days():
    pulls = []
    for seed in range(30):
        data = mission(
            np.random.default_rng(seed),
            epsilon=2e-4,
            turn_deg=(0, 0, 0.01),
            noise=0.2,
            day_noise=0.1,
        )
        estimate = estimate_scale(data)
        sigma = estimate.fit.sigma
        pulls.append(
            [
                (estimate.epsilon - 2e-4) / sigma[0],
                (estimate.fit.estimate[6] - np.radians(0.01)) / sigma[6],
            ]
        )
    width = np.sqrt(np.mean(np.square(pulls), axis=0))
    assert np.all((width > 0.6) & (width < 1.4)), width


def test_pulls_are_of_unit_width_where_pairs_lean_on_the_same_states():
    # Three images a scan; the returns of each lie between their states.
    block = np.array([[0.5, 0.5, 0.0], [0.25, 0.5, 0.25], [0.0, 0.5, 0.5]])
    shares = np.kron(np.eye(15), block)
    pulls, days = [], []
    for seed in range(20):
        data = mission(
            np.random.default_rng(seed), count=45, noise=0.02, shares=shares, state_noise=0.2
        )
        estimate = estimate_scale(data)
        pulls.append((estimate.epsilon - 2e-4) / estimate.epsilon_sigma)
        days += [(day.epsilon - 2e-4) / day.epsilon_sigma for day in estimate.days]
    assert 0.6 < np.sqrt(np.mean(np.square(pulls))) < 1.4
    assert 0.8 < np.sqrt(np.mean(np.square(days))) < 1.25


def test_pulls_have_no_long_tails_where_a_third_of_the_states_carries_the_weight():
    # As the scans of a mission lie: the returns of all three images lean on the middle one.
    shares = np.kron(np.eye(8), np.tile([0.12, 0.76, 0.12], (3, 1)))
    planted = [0.0, 0.0, 0.0, *np.radians([0.0, 0.0, 0.01])]
    pulls, carried = [], []
    for seed in range(20):
        data = mission(
            np.random.default_rng(seed),
            count=24,
            noise=0.02,
            turn_deg=(0.0, 0.0, 0.01),
            shares=shares,
            state_noise=0.2,
        )
        estimate = estimate_scale(data)
        fit = estimate.fit
        pulls.append((fit.estimate[1:7] - planted) / fit.sigma[1:7])
        moved = np.einsum("pnd,ns->ps", influence(estimate.equations, fit)[1:4], shares) ** 2
        carried.append(np.sum(moved[:, 1::3]) / np.sum(moved))
    assert np.min(carried) > 0.9
    assert 0.8 < np.sqrt(np.mean(np.square(pulls))) < 1.25
    # Student's t with the 17 degrees of freedom of eight passes has 0.5; its error here is 0.45.
    assert kurtosis(np.ravel(pulls)) < 1.5
    assert np.max(np.abs(pulls)) < 4.0


def test_states_on_which_nothing_leans_change_nothing():
    block = np.array([[0.5, 0.5, 0.0], [0.25, 0.5, 0.25], [0.0, 0.5, 0.5]])
    shares = np.kron(np.eye(8), block)
    data = mission(np.random.default_rng(4), count=24, shares=shares, state_noise=0.2)
    others = np.zeros((24, 7))
    more = replace(data, shares=np.hstack([others, shares[:, :9], others, shares[:, 9:]]))
    np.testing.assert_array_equal(more.source_displacements, data.source_displacements)
    few, many = estimate_scale(data), estimate_scale(more)
    np.testing.assert_array_equal(many.fit.estimate, few.fit.estimate)
    np.testing.assert_array_equal(many.fit.covariance, few.fit.covariance)
    assert many.days == few.days


def test_epsilon_of_one_pair_is_range_difference_over_range():
    data = mission(np.random.default_rng(2), epsilon=1e-4, noise=0.0)
    epsilon, _ = data.epsilon()
    np.testing.assert_allclose(epsilon, 1e-4, rtol=1e-10)
    shots = mission(np.random.default_rng(2), kind="shots", epsilon=1e-4, noise=0.0)
    np.testing.assert_allclose(shots.value[:, 0], 1e-4 * shots.range, rtol=1e-10)
    reference = mission(np.random.default_rng(2), trajectory="reference", epsilon=1e-4, noise=0.0)
    np.testing.assert_allclose(reference.epsilon()[0], 1e-4, rtol=1e-10)


def test_a_range_bias_is_reported_as_inseparable_if_ranges_are_alike():
    options = ScaleOptions(range_bias_prior_m=0.5)
    alike = estimate_scale(
        mission(
            np.random.default_rng(3), ranges=(5000.0, 5001.0), noise=0.02, bias=0.3, epsilon=0.0
        ),
        options=options,
    )
    assert any("epsilon and range_bias_m are not separable" in line for line in alike.reasons)
    assert any("the ranges vary by" in line for line in alike.reasons)
    # 0.3 m of bias may look like a scale of 6e-5: the sigma must cover it.
    assert abs(alike.epsilon) < 4 * alike.epsilon_sigma
    assert alike.epsilon_sigma > 5e-5
    varied = estimate_scale(
        mission(
            np.random.default_rng(3), ranges=(1000.0, 9000.0), noise=0.02, bias=0.3, epsilon=0.0
        ),
        options=options,
    )
    assert not any("not separable" in line for line in varied.reasons)
    assert varied.epsilon_sigma < 1e-5
    assert varied.fit.estimate[7] == pytest.approx(0.3, abs=4 * varied.fit.sigma[7])


def test_shots_at_one_longitude_know_the_size_less_well():
    def sigma(longitudes):
        data = mission(
            np.random.default_rng(4),
            kind="shots",
            trajectory="reference",
            noise=0.5,
            longitudes=longitudes,
            epsilon=0.0,
        )
        return estimate_scale(data).epsilon_sigma

    assert sigma((0.0, 0.3)) > 3 * sigma((0.0, 2 * np.pi))


def test_days_and_trends():
    generator = np.random.default_rng(5)
    data = mission(generator, count=150, noise=0.1)
    estimate = estimate_scale(data)
    assert [day.day for day in estimate.days] == list(DAYS)
    assert sum(day.count for day in estimate.days) == np.count_nonzero(estimate.fit.used)
    for day in estimate.days:
        assert day.epsilon == pytest.approx(2e-4, abs=5 * day.epsilon_sigma)
        # As published: a plain mean and its standard error, which ignores shared errors.
        assert day.mean == pytest.approx(2e-4, abs=5 * day.standard_error)
        assert day.standard_error < 2 * day.epsilon_sigma
    assert estimate.trends["longitude"].p_value > 1e-3
    wave = 1e-4 * np.cos(data.local_time_h * np.pi / 12.0 - 1.0)
    value = data.value + (wave * data.range)[:, None] * data.beam
    changed = ScaleObservations(**{**vars(data), "value": value})
    trend = estimate_scale(changed).trends["local_time"]
    assert trend.p_value < 1e-6
    assert trend.amplitude == pytest.approx(1e-4, abs=5 * trend.sigma)
    assert trend.phase_rad == pytest.approx(1.0, abs=0.3)


def test_too_few_observations_are_refused():
    data = mission(np.random.default_rng(6), count=1)
    with pytest.raises(NotObservableError, match="1 usable observation"):
        estimate_scale(data)


def test_wrong_shapes_are_refused():
    data = mission(np.random.default_rng(7), count=4)
    with pytest.raises(InvalidValueError):
        ScaleObservations(**{**vars(data), "kind": "shots"})
    with pytest.raises(InvalidValueError):
        ScaleObservations(**{**vars(data), "range": np.full(4, np.nan)})


def test_json_has_the_keys_that_other_programs_read():
    data = mission(np.random.default_rng(8))
    content = scale_json(data, estimate_scale(data), mean_radius=245.0)
    keys = (
        "epsilon",
        "epsilon_sigma",
        "size_correction_m",
        "size_correction_sigma_m",
        "center_offset_m",
        "center_offset_sigma_m",
        "prime_meridian_deg",
        "prime_meridian_sigma_deg",
        "covariance",
        "per_day",
        "reasons",
    )
    assert all(key in content for key in keys)
    assert content["size_correction_m"] == pytest.approx(245.0 * content["epsilon"])
    assert np.shape(content["covariance"]) == (len(PARAMETERS),) * 2


def test_a_scale_that_is_not_observed_has_the_same_keys_and_a_reason():
    data = mission(np.random.default_rng(8))
    full = scale_json(data, estimate_scale(data), mean_radius=245.0)
    none = unobserved_json("pairs", "spc", "no image shows the body")
    assert none.keys() == full.keys()
    assert none["epsilon"] is None
    assert "no image shows the body" in none["reasons"][0]
    assert consistency(none, {"scale": 1.0, "scale_sigma": 1e-4})["difference"] is None


def test_consistency_of_registration_and_scale():
    agree = consistency(
        {"epsilon": 2e-4, "epsilon_sigma": 1e-5}, {"scale": 1 / 1.0002, "scale_sigma": 5e-5}
    )
    assert agree["difference"] == pytest.approx(0.0, abs=1e-12)
    assert agree["p_value"] == pytest.approx(1.0)
    apart = consistency(
        {"epsilon": 2e-4, "epsilon_sigma": 1e-5}, {"scale": 1.0005, "scale_sigma": 1e-5}
    )
    assert apart["p_value"] < 1e-6
