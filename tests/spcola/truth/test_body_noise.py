"""The noise of the synthetic body against plain Python, and the cells of the cube around it."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.truth.body.cells import (
    CELL_REACH,
    cell_directions,
    cell_of,
    face_directions,
    index_features,
)
from spcola.truth.body.roughness import NOISE_RMS, add_noise, fractal_octaves, gradient_noise

MASK = 2**32 - 1


def _gradient(place: tuple[int, int, int], seed: int) -> np.ndarray:
    axes = (0x9E3779B1, 0x85EBCA77, 0xC2B2AE3D)
    word = (seed + sum(n * a for n, a in zip(place, axes, strict=True))) & MASK
    word = ((word ^ (word >> 16)) * 0x7FEB352D) & MASK
    word = ((word ^ (word >> 15)) * 0x846CA68B) & MASK
    word ^= word >> 16
    bits = np.array([word & 1023, (word >> 10) & 1023, (word >> 20) & 1023])
    return (bits - 511.5) / 511.5


def _reference(point: np.ndarray, seed: int) -> float:
    base = np.floor(point)
    value = 0.0
    for corner in np.ndindex(2, 2, 2):
        away = point - base - corner
        t = 1.0 - np.abs(away)
        weight = np.prod(t**3 * (t * (t * 6.0 - 15.0) + 10.0))
        i, j, k = (int(c) for c in base + corner)
        value += weight * (_gradient((i, j, k), seed) @ away)
    return value


def test_noise_is_the_reference_in_plain_python() -> None:
    for p in np.random.default_rng(2).uniform(-9.0, 9.0, (200, 3)):
        assert gradient_noise(*p, np.uint32(77)) == pytest.approx(_reference(p, 77), abs=1e-12)


def test_octaves_add_up() -> None:
    points = np.random.default_rng(2).uniform(-50.0, 50.0, (3, 20))
    octaves = fractal_octaves(0.5, 4.0, 0.9, 16.0, 2.0)
    out = np.zeros(20)
    add_noise(points, octaves, 5, out, 20)
    for n in range(20):
        expected = sum(
            amplitude * _reference(points[:, n] * f, (5 + int(number) * 0x27D4EB2F) & MASK)
            for f, amplitude, number in octaves
        )
        assert out[n] == pytest.approx(expected, abs=1e-11)


def test_a_value_does_not_depend_on_its_neighbours() -> None:
    points = np.random.default_rng(3).uniform(-50.0, 50.0, (3, 101))
    octaves = fractal_octaves(0.5, 4.0, 0.9, 16.0, 2.0)
    together = np.zeros(101)
    add_noise(points, octaves, 5, together, 101)
    for n in (0, 7, 100):
        alone = np.zeros(1)
        add_noise(points[:, n : n + 1].copy(), octaves, 5, alone, 1)
        assert alone[0] == together[n]


def test_noise_has_the_stated_rms() -> None:
    points = np.random.default_rng(1).uniform(-500, 500, (3, 200_000))
    out = np.zeros(200_000)
    add_noise(points, np.array([[1.0, 1.0, 0.0]]), 5, out, 200_000)
    assert out.std() == pytest.approx(NOISE_RMS, rel=0.005)
    assert abs(out.mean()) < 0.003
    # Each corner at its worst would make 1.5.
    assert np.abs(out).max() < 1.5


def test_octaves_grow_with_the_wavelength() -> None:
    octaves = fractal_octaves(0.06, 4.0, 0.9, 153.6, 1.2)
    assert len(octaves) == 8
    np.testing.assert_allclose(2.0 / octaves[:, 0], 153.6 / 2.0 ** np.arange(8))
    at_four = np.interp(4.0, 2.0 / octaves[::-1, 0], octaves[::-1, 1])
    assert at_four * NOISE_RMS == pytest.approx(0.06, rel=0.02)
    assert fractal_octaves(0.06, 4.0, 0.9, 1.0, 1.2).shape == (0, 3)


def _directions(count: int, seed: int = 0) -> np.ndarray:
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def test_a_direction_falls_in_its_cell() -> None:
    for number, (x, y, z) in enumerate(cell_directions(5)):
        assert cell_of(x, y, z, 5) == number
    for cells in (3, 16, 100):
        centres = cell_directions(cells)
        directions = _directions(20_000)
        found = np.array([cell_of(*d, cells) for d in directions])
        away = np.linalg.norm(directions - centres[found], axis=1)
        assert away.max() < CELL_REACH / cells


def test_no_corner_of_a_cell_is_further_than_said() -> None:
    for cells in (8, 64, 200):
        corners = face_directions(np.linspace(-1.0, 1.0, cells + 1))
        centres = cell_directions(cells).reshape(6, cells, cells, 3)
        for a, b in ((0, 0), (0, 1), (1, 0), (1, 1)):
            corner = corners[:, a : a + cells, b : b + cells]
            assert np.linalg.norm(corner - centres, axis=-1).max() < CELL_REACH / cells


def test_the_index_lists_every_feature_that_reaches_a_cell() -> None:
    features = np.vstack([_directions(60), [[1, 1, 1], [-1, 1, -1], [1, 0, 1], [0, 0, 1]]])
    features /= np.linalg.norm(features, axis=1, keepdims=True)
    chords = np.concatenate([np.geomspace(0.001, 0.9, 60), [0.05, 0.5, 0.2, 1.2]])
    index = index_features(features, features, chords, 12)
    for x in _directions(2000, seed=1):
        cell = cell_of(*x, 12)
        listed = index.items[index.start[cell] : index.start[cell + 1]]
        reaching = np.flatnonzero(np.linalg.norm(features - x, axis=1) < chords)
        assert np.isin(reaching, listed).all()
        assert np.all(np.diff(listed) > 0)
    assert len(index.items) < 0.35 * 864 * len(features)
