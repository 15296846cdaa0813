from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from fusion.scaling.fit import ScaleOptions, estimate_scale
from fusion.scaling.geometry import LidarPlacement
from fusion.scaling.shots import compare_shots, iterate_shots
from lidar.scans import Scan
from spcola.shape import Mesh, RayCaster

RADIUS, NOISE = 100.0, 0.35
TURN = np.radians([0.6, -0.8, 1.0])
SHIFT = np.array([0.1, -0.2, 0.15])


def bumpy(count, seed):
    """A sphere with relief of some metres over some twenty, and a mesh of its facets."""
    number = np.arange(count) + 0.5
    z = 1.0 - 2.0 * number / count
    longitude = np.pi * (1.0 + np.sqrt(5.0)) * number
    ring = np.sqrt(1.0 - z**2)
    unit = np.stack([ring * np.cos(longitude), ring * np.sin(longitude), z], axis=1)
    generator = np.random.default_rng(seed)
    waves, phases = 30.0 * generator.normal(size=(40, 3)), generator.uniform(0, 2 * np.pi, 40)
    relief = 0.4 * np.sum(np.cos(unit @ waves.T / 3.0 + phases), axis=1)
    return unit, RADIUS + relief, ConvexHull(unit)


def outward(unit, hull):
    """Facets of a hull, anticlockwise from outside."""
    a, b, c = (unit[hull.simplices[:, k]] for k in range(3))
    inward = np.sum(np.cross(b - a, c - a) * a, axis=1) < 0
    facets = hull.simplices.copy()
    facets[inward] = facets[inward][:, ::-1]
    return facets


@pytest.fixture(scope="module")
def compared():
    """Shots on a body that is turned and moved, against noisy shapes of it."""
    unit, radius, hull = bumpy(4000, 1)
    facets = outward(unit, hull)
    turned = Rotation.from_rotvec(-TURN).as_matrix()
    lidar = RayCaster(Mesh((radius[:, None] * unit) @ turned.T + SHIFT, facets))
    found = []
    for seed in range(3):
        generator = np.random.default_rng(seed)
        away = generator.normal(size=(700, 3))
        spacecraft = 10.0 * RADIUS * away / np.linalg.norm(away, axis=1, keepdims=True)
        beam = 0.3 * RADIUS * generator.normal(size=(700, 3)) - spacecraft
        beam /= np.linalg.norm(beam, axis=1, keepdims=True)
        hits = lidar.cast(spacecraft, beam)
        scan = Scan.of_points("S", hits.points[hits.hit], spacecraft=spacecraft[hits.hit])
        noisy = radius + NOISE * generator.normal(size=len(radius))
        shape = RayCaster(Mesh(noisy[:, None] * unit, facets))
        found.append(partial(compare_shots, scan, shape))
    return found


def test_iteration_removes_the_bias_of_noisy_slopes(compared):
    options = ScaleOptions(range_bias_prior_m=1e-3, pole_prior_deg=2.0)
    shares = []
    for at in compared:
        first = estimate_scale(at().observations, options=options)
        _, last = iterate_shots(at(), lambda known, at=at: at(known=known), options=options)
        shares.append([e.fit.estimate[4:7] @ TURN / (TURN @ TURN) for e in (first, last)])
        error = last.fit.estimate[1:7] - np.concatenate([SHIFT, TURN])
        assert np.all(np.abs(error) < 4.0 * last.fit.sigma[1:7])
    first, last = np.mean(shares, axis=0)
    assert first < 0.7
    assert last == pytest.approx(1.0, abs=0.02)


def test_where_it_lies_only_the_noise_of_the_shape_is_left(compared):
    place = LidarPlacement(SHIFT, TURN)

    def left(known):
        observations = compared[0](known=known).observations
        predicted = observations.design()[:, 0, 1:7] @ np.concatenate([SHIFT, TURN])
        return float(np.median(np.abs(observations.value[:, 0] - predicted)))

    # The median of |a normal error| is 0.67 of its sigma, within facets less.
    assert left(place) < 0.67 * NOISE
    assert left(None) > 1.15 * left(place)
    assert not place.agrees_with(np.zeros(8), np.full(8, 1e-3))
    assert place.agrees_with(np.concatenate([[0.0], SHIFT, TURN, [0.0]]), np.full(8, 1e-9))
