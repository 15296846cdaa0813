from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fusion.registration.fit import (
    FitOptions,
    LandmarkErrors,
    MatchedMapolas,
    ScanErrorPatterns,
    fit_mapolas,
)
from fusion.registration.observations import ImagedMapolas, place_mapolas
from fusion.registration.observations.combine import ObservationTypeSizes, joint_matches
from fusion.surfacematch import Match
from spcola.camera import Camera, SpcImage, project_image
from spcola.control.estimation import MeasuredLandmarks, state_covariance
from spcola.grids import MapletGrid
from spcola.imagematching import Sighting, SizeFactors

CAMERA = Camera(100.0, [128.5, 128.5], [[40.0, 0.0, 0.0], [0.0, 40.0, 0.0]], 256, 256)
NO_FIXES = MeasuredLandmarks(np.zeros((0, 3)), np.zeros((0, 2)), np.zeros((0, 3)))


def looking(name, position):
    position = np.array(position, dtype=float)
    boresight = -position / np.linalg.norm(position)
    across = np.cross(boresight, [0.1, 0.2, 1.0])
    across /= np.linalg.norm(across)
    axes = np.stack([across, np.cross(boresight, across), boresight])
    return SpcImage(
        name, "2019 JAN 01 00:00:00.000", CAMERA, -position, axes, [1.0, 0, 0],
        scobj_sigma=np.full(3, 0.2), pointing_sigma=np.full(3, 1e-5),
    )  # fmt: skip


def grids_facing_x(count, rng):
    directions = np.concatenate([np.ones((count, 1)), 0.5 * rng.normal(size=(count, 2))], axis=1)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return [MapletGrid.facing(75.0 * d, d, 0.5, 4) for d in directions]


def sighting(name, grid, images, truth, rng, *, noise=0.02):
    states = [state_covariance(image, [75.0, 0, 0], NO_FIXES, sigma_px=0.3) for image in images]
    seen = [np.array(project_image(image, truth)) + noise * rng.normal(size=2) for image in images]
    count = len(images)
    return Sighting(
        name, grid.center, tuple(images), np.array(seen).reshape(count, 2),
        np.tile(noise**2 * np.eye(2), (count, 1, 1)), np.array(states).reshape(count, 6, 6),
        np.full(count, 0.9), np.full(count, 0.8),
    )  # fmt: skip


def test_planted_displacements_are_recovered_with_their_sigma():
    rng = np.random.default_rng(4)
    places = 3000.0 * np.concatenate([np.ones((8, 1)), 0.5 * rng.normal(size=(8, 2))], axis=1)
    images = [looking(f"I{k}", place) for k, place in enumerate(places)]
    grids = grids_facing_x(30, rng)
    planted = 0.1 * rng.normal(size=(30, 3))
    found = place_mapolas(
        grids,
        [
            sighting(f"M{k}", grid, images, grid.center + d, rng)
            for k, (grid, d) in enumerate(zip(grids, planted, strict=True))
        ],
    )
    errors = np.array([match.displacement for match in found.matches]) - planted
    shared = found.effects @ np.swapaxes(found.effects, 1, 2)
    spread = np.array([match.covariance for match in found.matches]) + shared
    pulls = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(spread), errors)
    assert 2.0 < np.mean(pulls) < 4.5
    assert all(match.usable for match in found.matches)


def test_a_mapola_that_no_image_shows_has_a_reason():
    rng = np.random.default_rng(5)
    images = [looking(f"I{k}", [3000.0, 900.0 * k, 500.0]) for k in range(3)]
    grids = grids_facing_x(3, rng)
    seen = sighting("M0", grids[0], images, grids[0].center, rng)
    unseen = sighting("M1", grids[1], [], grids[1].center, rng)
    refused = replace(unseen, name="M2", left_out={"I0": "has no texture there"})
    found = place_mapolas(grids, [seen, unseen, refused])
    assert [match.usable for match in found.matches] == [True, False, False]
    assert found.matches[1].reason == "no image shows it"
    assert "has no texture there" in found.matches[2].reason
    assert found.effects.shape[:2] == (3, 3)
    outward = found.common[0, :, 0]
    np.testing.assert_allclose(np.cross(outward, grids[0].center), 0.0, atol=1e-12)
    # 0.003 pixels of 0.7 to 0.9 m.
    assert 0.002 < np.linalg.norm(outward) < 0.003
    assert not found.effects[1:].any()


def match(displacement, sigma, reason=""):
    grid = MapletGrid.facing([75.0, 0, 0], [1.0, 0, 0], 0.5, 4)
    d = np.array(displacement, dtype=float)
    covariance = np.diag(np.square(np.broadcast_to(sigma, 3)).astype(float))
    return grid, Match(
        "M",
        grid.center,
        d,
        covariance,
        grid.axes @ d,
        np.full(grid.shape, np.nan),
        0.9,
        0.9,
        3,
        reason,
    )


def imaged(*matches, effects=None):
    none = np.zeros((len(matches), 3, 0)) if effects is None else effects
    common = np.zeros((len(matches), 3, 1))
    return ImagedMapolas(matches, (), none, common, SizeFactors(1.0, 1.0, 1.0))


def by_heights(*matches, residual=0.0, effects=None):
    count = len(matches)
    scans = ScanErrorPatterns.independent([], 0.05)
    none = np.zeros((count, 3, 0)) if effects is None else effects
    return MatchedMapolas(matches, scans, none, np.tile(residual**2 * np.eye(3), (count, 1, 1)))


def test_both_observation_types_are_separate_rows():
    _, ground = match([0.1, 0.0, 0.0], 0.03)
    _, seen = match([0.0, 0.1, 0.0], 0.01)
    effects = np.full((1, 3, 2), 0.02)
    found = joint_matches(
        by_heights(ground, residual=0.01),
        imaged(seen, effects=effects),
        ObservationTypeSizes(0.04, 0.0),
    )
    first, second = found.rows.matches
    np.testing.assert_allclose(first.displacement, ground.displacement)
    np.testing.assert_allclose(second.displacement, seen.displacement)
    # The residual covariance of scans is in both rows, each with half the weight.
    np.testing.assert_allclose(first.covariance, (0.05**2 + 0.01**2) * np.eye(3), rtol=1e-9)
    np.testing.assert_allclose(second.covariance, 2 * 0.01**2 * np.eye(3), rtol=1e-9)
    np.testing.assert_allclose(found.effects, np.concatenate([np.zeros((1, 3, 2)), effects]))
    spread = (0.05**2 + 0.01**2) * np.eye(3) + effects[0] @ effects[0].T
    apart = second.displacement - first.displacement
    assert found.chi2[0] == pytest.approx(apart @ np.linalg.solve(spread, apart))


def test_contradicting_types_are_not_used_and_one_type_is_enough():
    _, ground = match([0.0, 0.0, 0.0], 0.01)
    _, far = match([0.5, 0.0, 0.0], 0.01)
    _, unseen = match([np.nan] * 3, 0.01, "no image shows it")
    found = joint_matches(
        by_heights(ground, ground), imaged(far, unseen), ObservationTypeSizes(0.02, 0.005)
    )
    reasons = [match.reason for match in found.rows.matches]
    assert "topography and images differ by" in reasons[0]
    assert reasons == [reasons[0], "", reasons[0], "no image shows it"]
    causes = [match.cause for match in found.rows.matches]
    assert causes[:3] == ["types-disagree", None, "types-disagree"]
    assert np.isnan(found.chi2[1])


def test_landmark_errors_affect_matches_by_topography_only():
    _, ground = match([0.1, 0.0, 0.0], 0.03)
    _, seen = match([0.0, 0.0, 0.0], 0.03)
    own = 0.04**2 * np.eye(3)[None]
    landmarks = LandmarkErrors(np.array([[0.1, 0, 0]]), own, np.zeros((1, 3, 1)), 0.3, 5, 9)
    heights = replace(by_heights(ground), landmarks=landmarks)
    found = joint_matches(heights, imaged(seen), ObservationTypeSizes(0.0, 0.0))
    assert found.chi2[0] == pytest.approx(0.0, abs=1e-9)
    assert found.rows.landmarks.offset[1].tolist() == [0.0, 0.0, 0.0]
    assert not found.rows.landmarks.own[1].any()


def test_an_error_that_images_share_leaves_the_scale_to_the_heights():
    """Images sharp but with one unknown scale: both determine the scale as heights alone."""
    rng = np.random.default_rng(6)
    points = rng.normal(size=(40, 3))
    points *= 75.0 / np.linalg.norm(points, axis=1, keepdims=True)
    larger, count = (0.2 / 75.0 * points)[:, :, None], len(points)
    ground, seen = [], []
    for point, error in zip(points, rng.normal(size=(count, 2, 3)), strict=True):
        _, one = match(0.03 * error[0], 0.03)
        _, other = match(0.003 * error[1] + 0.2 / 75.0 * point, 0.003)
        ground.append(replace(one, center=point))
        seen.append(replace(other, center=point))
    heights = by_heights(*ground)
    alone = fit_mapolas(heights, options=FitOptions(fixed_sizes=(0.0, 1.0)))
    joint = joint_matches(heights, imaged(*seen, effects=larger), ObservationTypeSizes(0.0, 0.0))
    both = fit_mapolas(joint.rows, [joint.effects], options=FitOptions(fixed_sizes=(0.0, 1.0, 1.0)))
    scale, rotation = both.covariance[6, 6], np.diag(both.covariance)[3:6]
    assert 0.9 < np.sqrt(scale / alone.covariance[6, 6]) <= 1.0
    assert np.all(rotation < 0.02 * np.diag(alone.covariance)[3:6])
    assert abs(both.similarity.scale - 1.0) < 3.0 * np.sqrt(scale)
