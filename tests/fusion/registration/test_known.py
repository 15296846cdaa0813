from __future__ import annotations

import numpy as np
import pytest

from fusion.registration.transform import PARAMETERS, KnownTransform
from fusion.registration.transform.known import inverse_jacobian, known_transform
from spcola.errors import InvalidValueError
from spcola.math import Affine, Similarity


def known(model, seed=1):
    generator = np.random.default_rng(seed)
    scale = 1.0 if model == "rigid" else 1.3
    turned = Similarity.from_rotation_vector([0.4, -0.7, 0.2], [30.0, -20.0, 45.0], scale)
    transform = turned.as_affine()
    if model == "affine":
        transform = Affine(transform.matrix + 0.1 * generator.normal(size=(3, 3)), [3.0, -2.0, 4.0])
    names = PARAMETERS[model]
    root = generator.normal(size=(len(names), len(names)))
    unit = np.array([0.02 if name.endswith("_m") else 1e-4 for name in names])
    return KnownTransform(model, transform, np.outer(unit, unit) * (root @ root.T))


def stepped(given, step):
    """The transform with a step of its parameters."""
    translation = given.transform.translation + step[:3]
    if given.model == "affine":
        return Affine(given.transform.matrix + step[3:].reshape(3, 3), translation)
    before = given.similarity
    scale = before.scale + (step[6] if given.model == "similarity" else 0.0)
    turn = Similarity.from_rotation_vector(step[3:6]).rotation
    return Affine(scale * turn @ before.rotation, translation)


def difference(one, other, model):
    """Parameters of `other` less those of `one`, rotations as small ones after `one`."""
    moved = other.translation - one.translation
    if model == "affine":
        return np.concatenate([moved, (other.matrix - one.matrix).ravel()])
    a, b = one.nearest_similarity(), other.nearest_similarity()
    turn = Similarity(b.rotation @ a.rotation.T).rotation_vector
    more = [b.scale - a.scale] if model == "similarity" else []
    return np.concatenate([moved, turn, more])


@pytest.mark.parametrize("model", ["rigid", "similarity", "affine"])
def test_the_sigmas_of_the_inverse_are_those_of_many_inverses(model):
    given = known(model)
    back = given.inverse()
    generator = np.random.default_rng(2)
    steps = generator.multivariate_normal(np.zeros(len(given.covariance)), given.covariance, 4000)
    inverses = [stepped(given, step).inverse() for step in steps]
    found = [difference(back.transform, inverse, model) for inverse in inverses]
    sigma = np.sqrt(np.diag(back.covariance))
    unit = np.outer(sigma, sigma)
    np.testing.assert_allclose(np.cov(np.array(found).T) / unit, back.covariance / unit, atol=0.08)


@pytest.mark.parametrize("model", ["rigid", "similarity", "affine"])
def test_the_inverse_of_the_inverse_is_the_transform(model):
    given = known(model)
    again = given.inverse().inverse()
    np.testing.assert_allclose(again.transform.matrix, given.transform.matrix, atol=1e-12)
    np.testing.assert_allclose(again.transform.translation, given.transform.translation)
    np.testing.assert_allclose(again.covariance, given.covariance, rtol=1e-9, atol=1e-20)
    forth = inverse_jacobian(model, given.transform)
    both = inverse_jacobian(model, given.transform.inverse()) @ forth
    np.testing.assert_allclose(both, np.eye(len(forth)), atol=1e-11)


def test_numbers_are_those_of_a_registration(scene):
    fit = scene.registered(scene.body(), 1)
    numbers = KnownTransform(fit.model, fit.transform, fit.covariance).numbers()
    scale, sigma, rotation, _ = fit.similarity_numbers()
    assert (numbers["scale"], numbers["scale_sigma"]) == (scale, sigma)
    assert numbers["rotation_deg"].tolist() == np.degrees(rotation).tolist()
    assert numbers["translation_sigma_m"].tolist() == np.sqrt(np.diag(fit.covariance))[:3].tolist()


def test_places_far_from_the_origin_are_less_certain():
    near, far = known("similarity").position_covariance(np.array([[0.0, 0, 0], [1e6, 0, 0]]))
    assert np.trace(far) > 100 * np.trace(near)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"model": "helmert"}, "model 'helmert'"),
        ({"model": "rigid"}, "is rigid, but its scale is not 1"),
        ({"model": "similarity", "covariance": [[1.0]]}, "covariance"),
        ({"model": "similarity", "covariance": "none"}, "covariance"),
        ({"model": "similarity", "covariance": (-np.eye(7)).tolist()}, "negative variances"),
        ({"model": "similarity", "covariance": np.tri(7).tolist()}, "not symmetric"),
        ({"model": "similarity", "covariance": np.full((7, 7), np.inf).tolist()}, "covariance"),
        ({"model": "similarity", "parameters": ["scale"]}, "parameters other than"),
    ],
)
def test_a_file_that_makes_no_sense_is_refused(content, words):
    transform = known("similarity").transform
    with pytest.raises(InvalidValueError, match=words) as caught:
        known_transform(content, transform, "given.json", do="mend it")
    assert str(caught.value).startswith("given.json: ")


def test_without_a_covariance_a_transform_counts_as_exact():
    transform = known("similarity").transform
    given = known_transform({"model": "similarity"}, transform, "given.json", do="")
    assert given.is_exact
    assert not known("similarity").is_exact
