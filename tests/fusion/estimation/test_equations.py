from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fusion.estimation import ErrorSizes, MixedOptions, Observations, fit_mixed
from fusion.estimation.equations import MixedEquations


@pytest.fixture
def case():
    """60 displacements of 3 components, with errors of scans and of days, and robust weights."""
    rng = np.random.default_rng(11)
    root = 0.1 * rng.normal(size=(60, 3, 3))
    scan, day = (np.eye(count)[rng.integers(count, size=60)] for count in (8, 3))
    effects = (np.einsum("ng,d->ndg", scan, [1.0, 0.5, 0.2]), np.repeat(day[:, None], 3, axis=1))
    observations = Observations(
        rng.normal(scale=0.4, size=(60, 3)) + effects[0] @ rng.normal(size=8),
        rng.normal(size=(60, 3, 4)),
        root @ np.swapaxes(root, 1, 2) + 0.02 * np.eye(3),
        effects,
    )
    options = MixedOptions(
        prior=np.array([np.inf, 1.0, 0.1, np.inf]),
        sizes=ErrorSizes(0.3, (0.6, 0.2)),
        scale=np.ones(4),
        names=("a", "b", "c", "d"),
        robust=False,
    )
    return observations, rng.uniform(0.2, 1.0, size=60), options


def at(case, logs):
    observations, weight, options = case
    independent, *shared = np.exp(logs)
    sizes = replace(options.sizes, independent=independent, shared=tuple(shared))
    return MixedEquations.solved(observations, weight, options, sizes)


def test_the_gradient_is_that_of_the_deviance(case):
    logs = np.log([0.3, 0.6, 0.2])
    gradient = at(case, logs).likelihood().gradient
    step = 1e-4 * np.eye(3)
    expected = [
        (at(case, logs + one).deviance - at(case, logs - one).deviance) / 2e-4 for one in step
    ]
    np.testing.assert_allclose(gradient, expected, rtol=1e-5, atol=1e-5)


def test_the_deviance_is_that_of_the_dense_covariance(case):
    observations, weight, options = case
    solved = at(case, np.log([0.3, 0.6, 0.2]))
    size = observations.value.size
    full = np.zeros((60, 3, 60, 3))
    each = (observations.covariance + 0.09 * np.eye(3)) / weight[:, None, None]
    full[np.arange(60), :, np.arange(60), :] = each
    full = full.reshape(size, size)
    for sigma, group in zip((0.6, 0.2), observations.effects, strict=True):
        rows = group.reshape(size, -1)
        full += sigma**2 * rows @ rows.T
    design = observations.design.reshape(size, 4)
    information = design.T @ np.linalg.solve(full, design) + np.diag(1.0 / options.prior**2)
    right = design.T @ np.linalg.solve(full, observations.value.ravel())
    expected = (
        observations.value.ravel() @ np.linalg.solve(full, observations.value.ravel())
        - right @ np.linalg.solve(information, right)
        + np.linalg.slogdet(full)[1]
        + np.linalg.slogdet(information)[1]
    )
    assert solved.deviance == pytest.approx(expected, rel=1e-9)


def test_the_sizes_of_a_fit_are_the_most_likely_ones(case):
    observations, _, options = case
    case = observations, np.ones(60), options

    def cost(logs):
        away = logs - np.log(options.sizes.all)
        return at(case, logs).deviance + float(away @ away) / options.sizes.width**2

    found = np.log(fit_mixed(observations, options).sizes.all)
    least = cost(found)
    for step in 0.02 * np.vstack([np.eye(3), -np.eye(3)]):
        assert cost(found + step) > least
