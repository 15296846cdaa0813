from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from spcola.camera import Camera, ImagePoint, SpcImage, project_image, rotate_axes
from spcola.control.bundle_adjustment import NetworkOptions, solve_network
from spcola.errors import InvalidValueError
from spcola.math.statistics import strongest

CENTER_SIGMA, POSITION_SIGMA, PIXEL_SIGMA = 0.05, 0.3, 0.2
CAMERA = Camera(100.0, np.array([512.0, 512.0]), np.array([[60.0, 0, 0], [0, 60.0, 0]]), 1024, 1024)


def looking_at_body(position):
    """Axes (3, 3) of a camera at `position` (3,) that looks at the origin."""
    sight = -position / np.linalg.norm(position)
    across = np.cross(sight, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(sight, across), sight])


def planted(seed, *, count=50, images=24):
    """A network of which V and states are off: names, V, images, and the errors of V (N, 3)."""
    generator = np.random.default_rng(seed)
    truth = generator.normal(size=(count, 3))
    truth *= 60.0 / np.linalg.norm(truth, axis=1, keepdims=True)
    truth *= generator.uniform(0.8, 1.2, size=(count, 1))
    names = [f"L{number:05d}" for number in range(count)]
    error = CENTER_SIGMA * generator.normal(size=truth.shape)
    taken = []
    for number in range(images):
        away = generator.normal(size=3)
        position = 1000.0 * away / np.linalg.norm(away)
        image = SpcImage(
            f"I{number}", "2019 MAR 01 00:00:00.000", CAMERA, -position,
            looking_at_body(position), np.array([1.0, 0.0, 0.0]),
        )  # fmt: skip
        facing = np.flatnonzero(truth @ away > 0.2 * 60.0 * np.linalg.norm(away))
        seen = np.stack(project_image(image, truth[facing]), axis=1)
        seen += PIXEL_SIGMA * generator.normal(size=seen.shape)
        points = tuple(
            ImagePoint(names[k], *place) for k, place in zip(facing, seen.tolist(), strict=True)
        )
        taken.append(
            replace(
                image,
                scobj=image.scobj + POSITION_SIGMA * generator.normal(size=3),
                axes=rotate_axes(image.axes, 1e-3 * generator.normal(size=3)),
                scobj_sigma=np.full(3, POSITION_SIGMA),
                landmarks=points,
            )
        )
    return names, truth + error, taken, error


def solved(names, centers, images, **options):
    sigma = np.full(centers.shape, CENTER_SIGMA)
    return solve_network(names, centers, sigma, images, options=NetworkOptions(**options))


def whole_covariance(network, patterns=None, rest=0.0):
    """Covariance (3N, 3N) of the landmarks."""
    patterns = network.shared if patterns is None else patterns
    flat = patterns.reshape(-1, patterns.shape[2])
    matrix = flat @ flat.T
    for number, block in enumerate(network.own + rest):
        where = slice(3 * number, 3 * number + 3)
        matrix[where, where] += block
    return matrix


def test_errors_of_landmarks_are_found_within_their_joint_covariance():
    squares, before, after = [], [], []
    for seed in range(8):
        names, centers, images, error = planted(seed)
        network = solved(names, centers, images)
        left = (error - network.offset).ravel()
        squares.append(left @ np.linalg.solve(whole_covariance(network), left) / left.size)
        before.append(np.mean(error**2))
        after.append(np.mean(left**2))
        assert network.pixel_sigma == pytest.approx(PIXEL_SIGMA, rel=0.12)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.12)
    assert np.sqrt(np.mean(after)) < 0.5 * np.sqrt(np.mean(before))


def test_what_the_network_shares_is_no_better_known_than_its_sigmas_allow():
    """The priors alone determine the position of the network: 50 centres, and 24 positions."""
    names, centers, images, _ = planted(1)
    network = solved(names, centers, images)
    mean = np.tile(np.eye(3), (1, len(names))) / len(names)
    spread = np.sqrt(np.diag(mean @ whole_covariance(network) @ mean.T))
    alone = CENTER_SIGMA / np.sqrt(len(names))
    both = 1.0 / np.hypot(1.0 / alone, np.sqrt(24) / POSITION_SIGMA)
    assert np.all((spread < alone) & (spread > both))
    # Taken for independent, the landmarks' own sigmas would promise far more.
    own = np.sqrt(np.mean([np.diag(block) for block in network.own])) / np.sqrt(len(names))
    assert own < 0.3 * alone


def test_strongest_patterns_and_the_rest_are_the_whole():
    names, centers, images, _ = planted(2)
    network = solved(names, centers, images)
    kept, rest = strongest(network.shared, least=0.02)
    assert 3 < kept.shape[2] < network.shared.shape[2]
    whole = np.einsum("nim,njm->nij", network.shared, network.shared)
    np.testing.assert_allclose(np.einsum("nim,njm->nij", kept, kept) + rest, whole, atol=1e-12)
    few, others = strongest(network.shared[:4], least=0.0)
    assert few.shape[2] <= 12
    np.testing.assert_allclose(others, 0.0, atol=1e-12)


@pytest.mark.parametrize("count", [0, 1, 5])
@pytest.mark.parametrize("patterns", [0, 1, 7, 20])
@pytest.mark.parametrize("least", [0.0, 1e-3, 1e9])
def test_any_number_of_places_and_patterns_has_its_strongest(count, patterns, least):
    """None of either, or none that is strong enough, is as good a case as any."""
    whole = np.random.default_rng(count + patterns).normal(size=(count, 3, patterns))
    kept, rest = strongest(whole, least=least)
    assert kept.shape[:2] == (count, 3)
    assert kept.shape[2] == (0 if least > 1e3 else min(3 * count, patterns))
    np.testing.assert_allclose(
        np.einsum("nim,njm->nij", kept, kept) + rest,
        np.einsum("nim,njm->nij", whole, whole),
        atol=1e-12,
    )


@pytest.mark.parametrize("landmarks", [0, 1, 2, 50])
@pytest.mark.parametrize("images", [0, 1, 24])
def test_a_network_may_be_of_any_size(landmarks, images):
    names, centers, seen, _ = planted(6)
    network = solved(names[:landmarks], centers[:landmarks], seen[:images])
    assert network.offset.shape == (landmarks, 3)
    assert network.shared.shape == (landmarks, 3, 6 * network.images)
    assert np.all(np.linalg.eigvalsh(network.own) > 0.0)
    assert np.isfinite(network.shared).all()


@pytest.mark.parametrize(("landmarks", "images"), [(50, 24), (8, 1), (50, 2), (3, 3)])
def test_places_that_fit_exactly_do_not_make_a_network_exact(landmarks, images):
    """Few images can explain any places: residuals of 0 without redundancy are no evidence."""
    names, centers, seen, _ = planted(7)
    names, centers = names[:landmarks], centers[:landmarks]
    exact = []
    for image in seen[:images]:
        places = np.stack(project_image(image, centers), axis=1).tolist()
        points = tuple(ImagePoint(name, *at) for name, at in zip(names, places, strict=True))
        exact.append(replace(image, landmarks=points))
    network = solved(names, centers, exact)
    redundant = landmarks == 50
    assert network.pixel_sigma == (0.005 if redundant else NetworkOptions().pixel_sigma)
    np.testing.assert_allclose(network.offset, 0.0, atol=1e-6)
    assert np.all(np.linalg.eigvalsh(network.own) > 0.0)


def test_without_images_landmarks_keep_their_sigmas():
    names, centers, _, _ = planted(3)
    network = solve_network(names, centers, np.full(centers.shape, np.nan), [])
    assert network.shared.shape == (50, 3, 0)
    assert not network.offset.any()
    np.testing.assert_allclose(network.own, np.tile(0.05**2 * np.eye(3), (50, 1, 1)))
    assert np.isnan(network.pixel_sigma)


def test_wild_places_and_those_marked_do_not_pull():
    names, centers, images, error = planted(4)
    clean = solved(names, centers, images)
    points = list(images[0].landmarks)
    points[0] = replace(points[0], pixel=points[0].pixel + 40.0)
    wild = [replace(images[0], landmarks=tuple(points)), *images[1:]]
    points[0] = replace(points[0], deweighted=True)
    marked = [replace(images[0], landmarks=tuple(points)), *images[1:]]
    number = names.index(points[0].name)
    for spoilt in (wild, marked):
        moved = solved(names, centers, spoilt).offset - clean.offset
        assert np.abs(moved).max() < 0.03
        assert np.linalg.norm(error[number] - clean.offset[number] - moved[number]) < 0.1


def test_images_are_thinned_and_a_landmark_behind_a_camera_is_refused():
    names, centers, images, _ = planted(5)
    assert solved(names, centers, images, most_images=10).images == 8
    turned = replace(images[3], axes=-images[3].axes * np.array([[-1.0], [1.0], [1.0]]))
    with pytest.raises(InvalidValueError, match="behind the camera"):
        solved(names, centers, [turned])
