from __future__ import annotations

import numpy as np
import pytest

from fusion.estimation import influence
from fusion.registration.fit.fit import fit_transform
from fusion.scaling.fit import ScaleOptions, estimate_scale
from fusion.scaling.fit.observation import ScaleObservations, uniform_displacements
from fusion.scaling.judging import consistency, covariance_by_maplets

MAPLETS, RADIUS, RANGE = 20, 75.0, 250.0
CENTER, MATCH = 0.06, 0.02


def directions(count):
    """Points spread over the sphere (Fibonacci's spiral)."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    longitude = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count)
    ring = np.sqrt(1.0 - z**2)
    return np.stack([ring * np.cos(longitude), ring * np.sin(longitude), z], axis=1)


NORMALS = directions(MAPLETS)
# Every pair lies over the three maplets nearest to its centre.
PAIRS = directions(14)
UNDER = np.zeros((len(PAIRS), MAPLETS))
for _row, _place in zip(UNDER, PAIRS, strict=True):
    _row[np.argsort(-NORMALS @ _place)[:3]] = 1.0 / 3.0


def observations(maplet_errors, generator):
    """Pairs that share maplets, from so near that errors of maplets dominate."""
    count = len(PAIRS)
    value = -UNDER @ maplet_errors + MATCH * generator.normal(size=(count, 3))
    return ScaleObservations(
        kind="pairs",
        label=tuple(map(str, range(count))),
        day=("2019-07-01",) * count,
        value=value,
        covariance=np.broadcast_to(MATCH**2 * np.eye(3), (count, 3, 3)),
        point=RADIUS * PAIRS,
        beam=-PAIRS,
        range=np.full(count, RANGE),
        normal=PAIRS,
        local_time_h=np.full(count, np.nan),
        shares=np.ones((count, 1)),
        trajectory="spc",
        ground=uniform_displacements(UNDER * CENTER),
    )


def both_fits(seed):
    """ε and the registration of one draw of maplets, and their covariance."""
    generator = np.random.default_rng(seed)
    errors = CENTER * generator.normal(size=(MAPLETS, 3))
    options = ScaleOptions(range_bias_prior_m=1e-6, single_sigma_m=1e-4)
    estimate = estimate_scale(observations(errors, generator), options=options)
    moved = errors + MATCH * generator.normal(size=(MAPLETS, 3))
    covariances = np.broadcast_to(MATCH**2 * np.eye(3), (MAPLETS, 3, 3))
    none = np.zeros((MAPLETS, 3, 0))
    registration = fit_transform(RADIUS * NORMALS, moved, covariances, none)
    content = {
        "model": "similarity",
        "scale": registration.similarity.scale,
        "scale_sigma": np.sqrt(registration.covariance[6, 6]),
    }
    of_scale = influence(registration.observations, registration.fit)[6]
    of_epsilon = -UNDER.T @ influence(estimate.equations, estimate.fit)[0]
    shared = covariance_by_maplets(of_epsilon, of_scale, np.full((MAPLETS, 3), CENTER))
    scale = {"epsilon": estimate.epsilon, "epsilon_sigma": estimate.epsilon_sigma}
    return scale, content, shared


@pytest.fixture(scope="module")
def draws():
    return [both_fits(seed) for seed in range(100)]


def test_z_is_of_unit_width_where_both_fits_lean_on_the_same_maplets(draws):
    joint = np.array([consistency(*draw)["z"] for draw in draws])
    # With 100 draws the width is known to 7 %.
    assert 0.85 < joint.std() < 1.15
    assert abs(joint.mean()) < 0.3


def test_taken_as_independent_the_difference_would_look_better_known_than_it_is(draws):
    alone = np.array([consistency(*draw[:2], 0.0)["z"] for draw in draws])
    joint = np.array([consistency(*draw)["z"] for draw in draws])
    assert alone.std() > 1.1 * joint.std()


def test_the_covariance_is_that_of_the_draws(draws):
    epsilon = np.array([scale["epsilon"] for scale, _, _ in draws])
    other = np.array([registration["scale"] for _, registration, _ in draws])
    stated = np.mean([shared for _, _, shared in draws])
    assert stated > 0
    assert np.cov(epsilon, other)[0, 1] == pytest.approx(stated, rel=0.35)


def test_without_a_covariance_the_sigma_is_a_bound():
    scale = {"epsilon": 2e-4, "epsilon_sigma": 3e-5}
    registration = {"scale": 1 / 1.0002, "scale_sigma": 5e-5}
    bound = consistency(scale, registration)
    assert bound["sigma_is"] == "bound"
    assert bound["difference_sigma"] == pytest.approx(8e-5)
    assert bound["covariance"] is None
    joint = consistency(scale, registration, 1e-9)
    assert joint["sigma_is"] == "joint"
    np.testing.assert_allclose(joint["covariance"], [[9e-10, 1e-9], [1e-9, 25e-10]])


def test_the_mean_of_both_scales_has_the_sigma_of_their_covariance():
    rng = np.random.default_rng(4)
    planted, spread = 2.5e-4, np.array([[4e-10, 0.6e-10], [0.6e-10, 1e-10]])
    pulls, sigmas = [], []
    for error in rng.multivariate_normal(np.zeros(2), spread, size=400):
        scale = {"epsilon": planted + error[0], "epsilon_sigma": 2e-5}
        registration = {"scale": 1.0 / (1.0 + planted) + error[1], "scale_sigma": 1e-5}
        found = consistency(scale, registration, covariance=0.6e-10)
        sigmas.append(found["epsilon_of_both_sigma"])
        pulls.append((found["epsilon_of_both"] - planted) / sigmas[-1])
    assert np.std(pulls) == pytest.approx(1.0, abs=0.08)
    assert max(sigmas) < 1e-5
    unknown = consistency(scale, registration)
    assert unknown["epsilon_of_both"] is None
