from __future__ import annotations

import numpy as np
import pytest

from fusion.estimation import ErrorSizes, MixedOptions, Observations, fit_mixed
from spcola.errors import InvalidValueError, NotObservableError

NOTHING_UNKNOWN = ErrorSizes(0.0, (0.0,))


def options(names=("a", "b"), *, sizes=NOTHING_UNKNOWN, prior=np.inf, robust=True):
    count = len(names)
    return MixedOptions(
        prior=np.full(count, prior), sizes=sizes, scale=np.ones(count), names=names, robust=robust
    )


def line(generator, count=40, groups=0):
    x = np.linspace(-1.0, 1.0, count)
    design = np.stack([np.ones(count), x], axis=1)[:, None, :]
    member = np.zeros((count, 1, groups))
    for index in range(count):
        if groups:
            member[index, 0, index % groups] = 1.0
    return x, design, member


def test_equals_weighted_least_squares_when_nothing_is_shared():
    generator = np.random.default_rng(1)
    _, design, member = line(generator)
    sigma = generator.uniform(0.5, 2.0, 40)
    value = generator.normal(size=(40, 1)) * sigma[:, None] + design[:, 0] @ [[1.0], [2.0]]
    covariance = (sigma**2)[:, None, None]
    fit = fit_mixed(Observations(value, design, covariance, (member,)), options(robust=False))
    rows = design[:, 0] / sigma[:, None]
    expected = np.linalg.lstsq(rows, value[:, 0] / sigma, rcond=None)[0]
    np.testing.assert_allclose(fit.estimate, expected, atol=1e-12)
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(rows.T @ rows), rtol=1e-10)


def test_equals_dense_generalised_least_squares_with_shared_effects():
    generator = np.random.default_rng(2)
    _, design, member = line(generator, groups=5)
    value = generator.normal(size=(40, 1))
    covariance = np.full((40, 1, 1), 0.04)
    sizes = ErrorSizes(0.3, (0.7,), width=0.0)
    fit = fit_mixed(
        Observations(value, design, covariance, (member,)), options(sizes=sizes, robust=False)
    )
    full = (0.04 + 0.09) * np.eye(40) + 0.49 * member[:, 0] @ member[:, 0].T
    inverse = np.linalg.inv(full)
    normal = design[:, 0].T @ inverse @ design[:, 0]
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(normal), atol=1e-12)
    np.testing.assert_allclose(
        fit.estimate, np.linalg.solve(normal, design[:, 0].T @ inverse @ value[:, 0]), atol=1e-6
    )


def test_pulls_are_of_unit_width_when_groups_share_an_error():
    pulls = []
    for seed in range(60):
        generator = np.random.default_rng(seed)
        _, design, member = line(generator, count=60, groups=12)
        shared = generator.normal(scale=0.5, size=12)
        noise = generator.normal(scale=0.2, size=60)
        value = (design[:, 0] @ [3.0, -1.0] + member[:, 0] @ shared + noise)[:, None]
        fit = fit_mixed(
            Observations(value, design, np.full((60, 1, 1), 1e-4), (member,)),
            options(sizes=ErrorSizes(0.3, (0.3,))),
        )
        pulls.append((fit.estimate - [3.0, -1.0]) / fit.sigma)
    width = np.std(pulls, axis=0)
    assert np.all((width > 0.8) & (width < 1.25)), width


def test_leaving_the_shared_error_out_would_understate_the_sigma():
    generator = np.random.default_rng(3)
    _, design, member = line(generator, count=60, groups=6)
    value = (member[:, 0] @ generator.normal(size=6) + 0.1 * generator.normal(size=60))[:, None]
    data = Observations(value, design, np.full((60, 1, 1), 1e-4), (member,))
    alone = fit_mixed(data, options(sizes=ErrorSizes(0.1, (0.0,))))
    shared = fit_mixed(data, options(sizes=ErrorSizes(0.1, (0.5,))))
    assert shared.sigma[0] > 2.0 * alone.sigma[0]


def test_outliers_are_rejected_and_do_not_pull():
    generator = np.random.default_rng(4)
    _, design, member = line(generator)
    value = (design[:, 0] @ [1.0, 2.0] + 0.01 * generator.normal(size=40))[:, None]
    clean = fit_mixed(Observations(value, design, np.full((40, 1, 1), 1e-4), (member,)), options())
    value = value.copy()
    value[[5, 20]] += 50.0
    fit = fit_mixed(Observations(value, design, np.full((40, 1, 1), 1e-4), (member,)), options())
    assert np.flatnonzero(~fit.used).tolist() == [5, 20]
    np.testing.assert_allclose(fit.estimate, clean.estimate, atol=0.003)


def test_a_free_direction_is_named():
    generator = np.random.default_rng(5)
    _, design, member = line(generator)
    design = np.concatenate([design, design[:, :, 1:]], axis=2)
    with pytest.raises(NotObservableError) as caught:
        fit_mixed(
            Observations(np.ones((40, 1)), design, np.ones((40, 1, 1)), (member,)),
            options(names=("offset", "slope", "twin")),
        )
    assert caught.value.parameters == ("slope", "twin")


def test_a_prior_makes_a_free_direction_as_uncertain_as_the_prior():
    generator = np.random.default_rng(6)
    _, design, member = line(generator)
    design = np.concatenate([design, design[:, :, 1:]], axis=2)
    fit = fit_mixed(
        Observations(np.ones((40, 1)), design, np.ones((40, 1, 1)) * 1e-8, (member,)),
        options(names=("offset", "slope", "twin"), prior=3.0),
    )
    np.testing.assert_allclose(fit.sigma[1:], 3.0 / np.sqrt(2.0), rtol=1e-3)


def test_nothing_to_fit_is_refused():
    empty = Observations(
        np.empty((0, 1)), np.empty((0, 1, 2)), np.empty((0, 1, 1)), (np.empty((0, 1, 0)),)
    )
    with pytest.raises(InvalidValueError, match="no observation"):
        fit_mixed(empty, options())
