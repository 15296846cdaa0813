"""Two clouds of one ground aligned: planted transforms, their sigmas, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from fusion.estimation.verdict import Code
from fusion.registration.clouds import Alignment, AlignOptions, align_clouds
from fusion.registration.clouds.composed import composed
from fusion.registration.direct import DirectRegistration
from fusion.registration.transform import PARAMETERS, KnownTransform, Model
from spcola.errors import InvalidValueError, RejectedResultError
from spcola.math import Affine, Similarity

Array = NDArray[np.float64]
NOISE_M = 0.02


def site(seed: int, number: int, count: int = 20_000) -> Array:
    """Points of a rough square of 40 m, at random places that `number` draws."""
    ground, draw = np.random.default_rng(seed), np.random.default_rng([seed, number])
    waves = ground.normal(size=(200, 2)) * ground.uniform(0.2, 6.0, 200)[:, None]
    height = 0.12 / np.linalg.norm(waves, axis=1) ** 1.2
    phase = ground.uniform(0.0, 2.0 * np.pi, 200)
    x = draw.uniform(-20.0, 20.0, (count, 2))
    z = np.cos(x @ waves.T + phase) @ np.minimum(height, 0.5)
    return np.column_stack([x, z + NOISE_M * draw.normal(size=count)])


def body(seed: int, number: int, count: int = 15_000) -> Array:
    """Points of a rough ellipsoid of some 100 m."""
    ground, draw = np.random.default_rng(seed), np.random.default_rng([seed, number])
    waves = ground.normal(size=(60, 3))
    waves *= (ground.uniform(2.0, 25.0, 60) / np.linalg.norm(waves, axis=1))[:, None]
    height = 8.0 / np.linalg.norm(waves, axis=1) * ground.normal(size=60)
    phase = ground.uniform(0.0, 2.0 * np.pi, 60)
    unit = draw.normal(size=(count, 3))
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    radius = 100.0 + np.cos(unit @ waves.T + phase) @ height + NOISE_M * draw.normal(size=count)
    return unit * radius[:, None] * [1.1, 1.0, 0.9]


PLANTED = Similarity.from_rotation_vector(
    np.radians([0.05, -0.08, 0.1]), [0.3, -0.2, 0.25], 1.0008, "fixed", "moving"
)


def pulls(found: KnownTransform, planted: Similarity) -> Array:
    """Errors of translation, rotation and scale (7,) over their sigmas."""
    turn = Similarity(found.similarity.rotation @ planted.rotation.T).rotation_vector
    shift = found.transform.translation - planted.translation
    error = np.array([*shift, *turn, found.similarity.scale - planted.scale])
    return error / np.sqrt(np.diag(found.covariance))


def known(moving: Array, fixed: Array) -> KnownTransform:
    found = align_clouds(moving, fixed).registration
    return KnownTransform(found.model, found.transform, found.covariance)


def test_a_planted_transform_is_recovered_within_its_sigmas_far_from_the_origin() -> None:
    away = np.array([2000.0, -500.0, 300.0])
    drawn = []
    for seed in range(8):
        moving = PLANTED.inverse().apply(site(seed, 0) + away)
        drawn.append(pulls(known(moving, site(seed, 1) + away), PLANTED))
    # Seven numbers that are correlated: of eight draws the width is known to some 15 %.
    assert 0.7 < np.sqrt(np.mean(np.square(drawn))) < 1.35


def test_a_planted_transform_of_a_body_is_recovered_within_its_sigmas() -> None:
    planted = Similarity.from_rotation_vector([0.005, -0.004, 0.009], [0.5, -0.4, 0.3], 1.002)
    drawn = []
    for seed in range(4):
        found = known(planted.inverse().apply(body(seed, 0)), body(seed, 1))
        drawn.append(pulls(found, planted))
    assert 0.6 < np.sqrt(np.mean(np.square(drawn))) < 1.5


def test_a_body_is_found_in_any_orientation_and_a_part_of_it_too() -> None:
    turned = Similarity.from_rotation_vector([0.4, 0.3, 1.4], [3.0, -1.0, 0.5])
    part = body(3, 0)
    found = align_clouds(turned.inverse().apply(part[part[:, 0] > -40.0]), body(3, 1))
    assert found.ground == "body"
    assert found.verdict.judgement == "accepted", found.verdict
    assert np.abs(found.transform.matrix - turned.rotation).max() < 2e-3
    assert np.abs(found.transform.translation - turned.translation).max() < 0.1


@pytest.mark.parametrize("model", list(PARAMETERS))
def test_a_cloud_that_was_moved_before_has_the_same_errors_on_the_ground(model: Model) -> None:
    """The covariance of where a point goes does not depend on how the way there is parted."""
    draw = np.random.default_rng(2)
    root = draw.normal(size=(len(PARAMETERS[model]),) * 2) * 1e-3
    matrix = PLANTED.rotation if model == "rigid" else PLANTED.scale * PLANTED.rotation
    found = DirectRegistration(
        model, Affine(matrix, [1.0, 2.0, 3.0], "fixed", "moving"), root @ root.T,
        np.zeros(3), 0.0, 0.1, 1, 1, 1, 1, True,
    )  # fmt: skip
    turn = Similarity.from_rotation_vector([0.7, -0.2, 0.4]).rotation
    scale = 1.0 if model == "rigid" else 3.0
    before = Affine(scale * turn, [10.0, -20.0, 5.0], "moving", "raw")
    whole = composed(found, before, np.array([5.0, 6.0, 7.0]))
    points = 50.0 * draw.normal(size=(4, 3))
    moved = found.transform.apply(before.apply(points)) + np.array([5.0, 6.0, 7.0])
    np.testing.assert_allclose(whole.transform.apply(points), moved, rtol=1e-12)
    one, two = (
        KnownTransform(model, each.transform, each.covariance).position_covariance(at)
        for each, at in ((whole, points), (found, before.apply(points)))
    )
    np.testing.assert_allclose(one, two, rtol=1e-6, atol=1e-12)


def test_the_shift_is_that_of_the_middle_of_the_ground() -> None:
    away = np.array([1e5, 0.0, 0.0])
    found = align_clouds(site(1, 0) + away + [0.1, 0.0, -0.2], site(1, 1) + away)
    shift, covariance = found.shift
    sigma = np.sqrt(np.diag(covariance))
    assert np.all(np.abs(shift - [-0.1, 0.0, 0.2]) < 4.0 * sigma + 1e-9)
    assert sigma.max() < 0.01
    content = found.as_json()
    # At the origin, 100 km away, the rotation makes the translation uncertain by metres.
    assert np.max(content["translation_sigma_m"]) > 100.0 * sigma.max()
    back = content["inverse"]["scale"] * content["scale"]
    assert back == pytest.approx(1.0)


def test_ground_with_a_large_scale_is_doubtful_and_names_the_unit() -> None:
    found = align_clouds(body(1, 0, 8000) / 0.3048, body(1, 1, 8000))
    codes = {finding.code: finding for finding in found.verdict.findings}
    assert found.verdict.judgement == "doubtful"
    assert "feet" in codes[Code.LARGE_SCALE].text


def codes(found: Alignment) -> set[Code]:
    return {finding.code for finding in found.verdict.findings}


def text(found: Alignment) -> str:
    return "; ".join(finding.text for finding in found.verdict.findings)


def test_other_ground_is_refused_as_unrelated() -> None:
    for seed in (2, 3):
        found = align_clouds(site(seed, 0), site(1, 1))
        assert found.verdict.judgement == "refused"
        assert codes(found) == {Code.RELIEF_UNRELATED}


@pytest.mark.parametrize(
    ("matrix", "away", "named"),
    [
        (np.diag([-1.0, 1.0, 1.0]), 0.0, "mirrored in X"),
        (np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), 0.0, "90.0° about Z"),
        (np.diag([1.0, 1.0, -1.0]), 900.0, "mirrored in Z"),
    ],
)
def test_flat_ground_in_another_frame_is_refused_and_the_frame_named(
    matrix: Array, away: float, named: str
) -> None:
    """Axes may be exchanged about the middle of the ground or about a far origin."""
    found = align_clouds((site(1, 0) + away) @ matrix.T, site(1, 1) + away)
    assert found.verdict.judgement == "refused"
    assert Code.FITS_OTHERWISE in codes(found), found.verdict
    assert named in text(found)


def test_a_mirrored_body_is_refused_and_the_mirror_named() -> None:
    found = align_clouds(body(1, 0) * [1.0, 1.0, -1.0], body(1, 1))
    assert found.verdict.judgement == "refused"
    assert Code.FITS_OTHERWISE in codes(found)
    assert "mirrored" in text(found)


def test_what_cannot_be_aligned_is_refused_with_a_code_and_has_no_transform() -> None:
    fixed = site(1, 1, 6000)
    plane = np.random.default_rng(0).uniform(-20, 20, (2, 8000, 3)) * [1.0, 1.0, 1e-3]
    cloud = 60.0 * np.random.default_rng(0).normal(size=(15_000, 3))
    for moving, ground, code, why in (
        (fixed / 1000.0, fixed, Code.LARGE_SCALE, "kilometres for metres"),
        (fixed + np.array([500.0, 0.0, 0.0]), fixed, Code.NO_OVERLAP, "do not overlap"),
        (plane[0], plane[1], Code.NOT_DETERMINED, "does not determine"),
        (cloud, body(1, 1), Code.NOT_DETERMINED, "does not determine"),
    ):
        found = align_clouds(moving, ground)
        assert found.verdict.judgement == "refused"
        assert code in codes(found), found.verdict
        assert why in text(found)
        with pytest.raises(RejectedResultError, match=why):
            found.transform  # noqa: B018
        content = found.as_json()
        assert content["verdict"] == "refused"
        assert content["translation_m"] is None
        assert content.keys() == align_clouds(fixed, fixed).as_json().keys()


def test_input_that_is_no_two_clouds_of_one_ground() -> None:
    fixed = site(1, 1, 3000)
    spoilt = fixed.copy()
    spoilt[7] = np.nan
    for moving, why in (
        (fixed[:50], "50 points, 100 are needed"),
        (spoilt, "1 points that are not finite"),
        (np.ones((200, 3)), "all its points at one place"),
    ):
        with pytest.raises(InvalidValueError, match=why):
            align_clouds(moving, fixed)


def test_partly_overlapping_clouds_are_aligned_by_what_they_share() -> None:
    one, two = site(4, 0), site(4, 1)
    moving, fixed = one[one[:, 0] < 10.0], two[two[:, 0] > -12.0]
    options = AlignOptions(model="rigid", capture_m=1.0)
    found = align_clouds(moving + np.array([0.4, -0.3, 0.2]), fixed, options=options)
    assert found.verdict.judgement == "accepted"
    assert np.abs(found.shift[0] - [-0.4, 0.3, -0.2]).max() < 0.02
