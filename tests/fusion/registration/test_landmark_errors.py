"""What landmarks' errors do to a registration."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.registration.fit import (
    FitOptions,
    LandmarkErrors,
    MatchedMapolas,
    ScanErrorPatterns,
    fit_mapolas,
)
from fusion.surfacematch import Match
from spcola.control.bundle_adjustment import Network
from spcola.math import lattice

COUNT, RADIUS, OWN, SHARED = 120, 200.0, 0.01, 0.04


def patterns():
    """Two shared error patterns of landmarks: one side up, and all toward the east."""
    directions = lattice(COUNT)
    up = directions * np.where(directions[:, :1] > 0.3, SHARED, 0.0)
    east = np.cross([0.0, 0.0, 1.0], directions) * SHARED
    return np.stack([up, east], axis=-1)


def network():
    names = tuple(f"L{number:04d}" for number in range(COUNT))
    own = np.tile(OWN**2 * np.eye(3), (COUNT, 1, 1))
    return Network(names, np.zeros((COUNT, 3)), own, patterns(), 0.3, 10, 500)


def matched(generator):
    """Mapolas of a body whose maplets have the errors of that network, and no others."""
    centers = RADIUS * lattice(COUNT)
    error = OWN * generator.normal(size=(COUNT, 3)) + patterns() @ generator.normal(size=2)
    covariance = 1e-6 * np.eye(3)
    matches = [
        Match(f"L{number:04d}", center, moved, covariance, moved, np.zeros((3, 3)), 0.9, 1.0, 3, "")
        for number, (center, moved) in enumerate(zip(centers, error, strict=True))
    ]
    scans = ScanErrorPatterns.independent((), 0.0)
    none = np.zeros((COUNT, 0))
    return MatchedMapolas(
        matches, scans, scans.at(none, centers), scans.residual_covariance(none, centers)
    )


def pulls(landmarks, seeds=40):
    """Estimates over sigmas (S, 7) of a transform that is none."""
    found = []
    for seed in range(seeds):
        mapolas = matched(np.random.default_rng(seed))
        fit = fit_mapolas(
            MatchedMapolas(
                mapolas.matches,
                mapolas.scans,
                mapolas.effects,
                mapolas.residual_covariance,
                landmarks,
            ),
            options=FitOptions(),
        )
        estimate = [
            *fit.transform.translation, *fit.similarity.rotation_vector, fit.similarity.scale - 1.0
        ]  # fmt: skip
        found.append(np.array(estimate) / np.sqrt(np.diag(fit.covariance)))
    return np.array(found)


def test_errors_that_landmarks_share_are_in_the_sigmas():
    errors = LandmarkErrors.of_mapolas(network(), network().names, 0.05)
    assert errors.shared.shape == (COUNT, 3, 2)
    known = np.sqrt(np.mean(pulls(errors) ** 2, axis=0))
    assert np.all((known > 0.7) & (known < 1.35)), known
    # Taken for errors of each alone, the rotation about Z is wrong by many of its sigmas.
    assert np.sqrt(np.mean(pulls(None)[:, 5] ** 2)) > 5.0


def test_the_estimated_error_of_a_landmark_is_subtracted_from_its_match():
    moved = np.array([0.03, -0.02, 0.01])
    moved_network = network()
    moved_network = Network(
        moved_network.names,
        moved_network.offset + moved,
        moved_network.own,
        moved_network.shared,
        0.3,
        10,
        500,
    )
    mapolas = matched(np.random.default_rng(0))

    def translation(landmarks):
        whole = MatchedMapolas(
            mapolas.matches, mapolas.scans, mapolas.effects, mapolas.residual_covariance, landmarks
        )
        return fit_mapolas(whole, options=FitOptions()).transform.translation

    names = moved_network.names
    before = translation(LandmarkErrors.of_mapolas(network(), names, 0.05))
    after = translation(LandmarkErrors.of_mapolas(moved_network, names, 0.05))
    np.testing.assert_allclose(before - after, moved, atol=1e-6)


def test_a_mapola_without_a_landmark_errs_alone():
    errors = LandmarkErrors.of_mapolas(network(), ["L0003", "other"], 0.05)
    np.testing.assert_allclose(errors.own[1], 0.05**2 * np.eye(3))
    assert not errors.shared[1].any()
    assert errors.as_json()["own_sigma_m"] == pytest.approx(0.036, abs=0.003)
