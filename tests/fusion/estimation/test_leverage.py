from __future__ import annotations

import numpy as np

from fusion.estimation import ErrorSizes, MixedOptions, Observations, fit_mixed, influence


def test_the_estimate_is_what_its_influence_makes_of_the_values():
    generator = np.random.default_rng(1)
    design = generator.normal(size=(40, 3, 4))
    effects = generator.normal(size=(40, 3, 6))
    value = design @ np.array([1.0, -2.0, 0.5, 0.1]) + 0.1 * generator.normal(size=(40, 3))
    value[7] += 5.0
    observations = Observations(
        value, design, np.broadcast_to(0.01 * np.eye(3), (40, 3, 3)), (effects, effects[:, :, :2])
    )
    options = MixedOptions(
        prior=np.array([np.inf, 1.0, 2.0, 0.5]),
        sizes=ErrorSizes(0.05, (0.1, 0.0)),
        scale=np.ones(4),
        names=("a", "b", "c", "d"),
    )
    fit = fit_mixed(observations, options)
    moved = influence(observations, fit)
    np.testing.assert_allclose(np.einsum("pnd,nd->p", moved, value), fit.estimate, rtol=1e-9)
    assert not fit.used[7]
    assert not moved[:, 7].any()
