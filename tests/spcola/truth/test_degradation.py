"""What SPC does to heights: against least squares, planes, boulders, and light by formula."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from spcola.errors import SettingsError
from spcola.truth.body import stream
from spcola.truth.solution.degradation import (
    Darkness,
    Smoothing,
    integrated,
    quadratic,
    shaded,
    smoothed,
    unresolved,
)
from spcola.truth.solution.noise import correlated_noise, drift_noise

GSD = 0.35


def _boulder(across: float, size: int = 61) -> np.ndarray:
    """Return half a ball, `across` metres wide, sunk by a fifth, in the middle of a plane."""
    steps = GSD * (np.arange(size) - size // 2)
    square = steps[:, None] ** 2 + steps[None, :] ** 2
    return np.clip(np.sqrt(np.clip(across**2 / 4.0 - square, 0, None)) - 0.1 * across, 0, None)


@pytest.mark.parametrize(
    ("across", "least", "most"), [(2.0, 0.20, 0.30), (4.0, 0.25, 0.35), (8.0, 0.35, 0.45)]
)
def test_boulders_come_out_short_of_any_size(across: float, least: float, most: float) -> None:
    truth = _boulder(across)
    height = smoothed(truth, GSD, Smoothing())
    # By about a cell, as the mission's models were (Weirich et al., section 4).
    assert least < truth.max() - height.max() < most
    # The ground further off is unchanged, except for the part of the integral that stereo leaves.
    assert np.abs(height[:4]).max() < 0.05 * truth.max()
    np.testing.assert_allclose(height, height.T, atol=1e-12)
    np.testing.assert_allclose(height, height[::-1], atol=1e-12)


def test_what_is_steeper_loses_more() -> None:
    low, high = (smoothed(f * _boulder(4.0), GSD, Smoothing()).max() / f for f in (0.2, 1.0))
    assert high < 0.9 * low


def test_a_plane_is_not_changed_by_smoothing() -> None:
    m, n = np.meshgrid(np.arange(80.0), np.arange(80.0), indexing="ij")
    plane = 0.1 * m - 0.2 * n
    # But at the edges, where nothing is known beyond them.
    inner = (slice(36, -36),) * 2
    np.testing.assert_allclose(smoothed(plane, GSD, Smoothing())[inner], plane[inner], atol=2e-3)


def test_tilt_and_curvature_are_fitted_exactly_and_removed() -> None:
    generator = stream(6, "surface")
    m, n = np.meshgrid(np.linspace(-1, 1, 30), np.linspace(-1, 1, 41), indexing="ij")
    terms = np.stack([np.ones_like(m), m, n, m * m, m * n, n * n], axis=-1)
    surface = terms @ generator.normal(size=6)
    np.testing.assert_allclose(quadratic(surface), surface, atol=1e-12)
    rough = generator.normal(size=m.shape)
    fit = np.linalg.lstsq(terms.reshape(-1, 6), rough.ravel())[0]
    np.testing.assert_allclose(quadratic(rough), terms @ fit, atol=1e-12)


def test_no_smoothing_changes_nothing() -> None:
    height = stream(1, "heights").normal(size=(20, 20))
    none = Smoothing(smoothing=0.0)
    np.testing.assert_array_equal(smoothed(height, GSD, none), height)
    np.testing.assert_array_equal(unresolved(height, none), 0.0)


def test_the_integral_is_that_of_least_squares() -> None:
    generator = stream(2, "integral")
    height, kept = generator.normal(size=(7, 9)), generator.uniform(0.2, 1.0, size=(7, 9))
    anchor = 3.0
    number = np.arange(63).reshape(7, 9)
    rows, wanted = [], []
    for one, other in (
        *zip(number[1:].ravel(), number[:-1].ravel(), strict=True),
        *zip(number[:, 1:].ravel(), number[:, :-1].ravel(), strict=True),
    ):
        row = np.zeros(63)
        row[[one, other]] = 1.0, -1.0
        rows.append(row)
        share = 0.5 * (kept.flat[one] + kept.flat[other])
        wanted.append(share * (height.flat[one] - height.flat[other]))
    matrix = np.vstack([rows, np.eye(63) / anchor])
    solution = np.linalg.lstsq(matrix, np.concatenate([wanted, height.ravel() / anchor]))[0]
    np.testing.assert_allclose(integrated(height, kept, anchor).ravel(), solution, atol=1e-12)
    np.testing.assert_allclose(integrated(height, np.ones((7, 9)), anchor), height, atol=1e-12)


def test_good_light_does_nothing() -> None:
    shade = shaded(np.full((20, 20), 0.4), Darkness())
    assert (shade.noise == 1.0).all()
    assert not shade.depth.any()
    assert not shade.lost.any()


def test_depth_grows_into_the_dark_and_narrow_shadows_are_bridged() -> None:
    share = np.full((80, 80), 0.4)
    share[:, 40:] = 0.0
    depth = shaded(share, Darkness()).depth[40]
    assert np.all(np.diff(depth) >= -1e-12)
    assert depth[30] == 0.0
    assert depth[60] == pytest.approx(1.0, abs=1e-3)
    share[:, 44:] = 0.4
    narrow = shaded(share, Darkness()).depth[40]
    assert 0.1 < narrow.max() < 0.5


def test_noise_is_greatest_at_the_edge_of_the_dark_and_form_is_lost_inside() -> None:
    share = np.broadcast_to(np.linspace(0.5, 0.0, 101), (101, 101)).copy()
    darkness = Darkness(poor=0.4, dark=0.1, noise=3.0)
    shade = shaded(share, darkness)
    assert shade.noise.max() <= 3.0
    middle = shade.noise[50]
    assert middle[:20] == pytest.approx(1.0)
    assert 75 <= np.argmax(middle) <= 92
    height = stream(3, "heights").normal(size=share.shape)
    left = shade.blurred(height)
    np.testing.assert_array_equal(left[:, :70], height[:, :70])
    np.testing.assert_array_equal(height, stream(3, "heights").normal(size=share.shape))
    assert left[:, -1].std() < height[:, -1].std()


def test_lost_is_what_lies_too_deep_in_ground_that_is_never_lit() -> None:
    share = np.full((41, 41), 0.0)
    share[:, 0] = 0.01  # hardly, but lit
    lost = shaded(share, Darkness(reach=10.0)).lost
    assert not lost[:, :11].any()
    assert lost[:, 11:].all()
    assert not shaded(share, Darkness(reach=np.inf)).lost.any()
    none = np.zeros((5, 5))
    assert shaded(none, Darkness(reach=10.0)).lost.all()
    assert not shaded(none, Darkness(reach=np.inf)).lost.any()


def test_noise_has_rms_1_and_the_stated_correlation() -> None:
    samples = np.array([correlated_noise((99, 99), 5.0, stream(k, "noise")) for k in range(30)])
    assert samples.std() == pytest.approx(1.0, rel=0.03)
    at_five = np.mean(samples[:, :, 5:] * samples[:, :, :-5])
    assert at_five == pytest.approx(np.exp(-1.0), abs=0.06)


def test_drift_has_rms_1_and_belongs_to_places() -> None:
    points = stream(4, "points").uniform(-500.0, 500.0, size=(200, 100, 3))
    drift = drift_noise(points, 14.0, 5)
    assert drift.shape == (200, 100)
    assert drift.std() == pytest.approx(1.0, rel=0.03)
    assert abs(drift.mean()) < 0.03
    np.testing.assert_array_equal(drift_noise(points[7, 3:5], 14.0, 5), drift[7, 3:5])
    assert abs(np.mean(drift * drift_noise(points, 14.0, 6))) < 0.03
    near = drift_noise(points + np.array([0.35, 0.0, 0.0]), 14.0, 5)
    assert np.mean(near * drift) > 0.95


@pytest.mark.parametrize(
    "wrong",
    [{"smoothing": 3.0}, {"smoothing": -1.0}, {"steepest": 0.0}, {"anchor": 0.0}, {"expected": -1}],
)
def test_softness_out_of_range_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(SettingsError):
        replace(Smoothing(), **wrong)


@pytest.mark.parametrize(
    "wrong",
    [{"dark": 0.0}, {"dark": 0.5}, {"poor": 2.0}, {"noise": 0.5}, {"drift": -1.0}, {"reach": -1.0}],
)
def test_darkness_out_of_range_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(SettingsError):
        replace(Darkness(), **wrong)
