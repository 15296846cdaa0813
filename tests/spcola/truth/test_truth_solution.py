"""The SPC solution: exact without errors, and as wrong as stated with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from spcola.errors import SettingsError
from spcola.similarity import Similarity
from spcola.truth.body import BodySettings, TruthBody
from spcola.truth.solution import (
    SolutionSettings,
    correlated_noise,
    heights_in_frame,
    lattice,
    make_maplet,
    smoothed,
    spc_shape,
)
from spcola.truth.streams import stream

SMALL = SolutionSettings(gsd=0.5, half_size=16, maplets=40)
EXACT = replace(SMALL, noise=0.0, center_sigma=0.0, smoothing=0.0, albedo_noise=0.0)
TO_SPC = Similarity.from_rotation_vector([1e-4, -2e-4, 3e-4], [0.07, -0.05, 0.04], 0.99975)


@pytest.fixture(scope="module")
def body() -> TruthBody:
    return TruthBody(BodySettings(seed=7, radius=40.0))


def _maplet(body: TruthBody, settings: SolutionSettings, direction: list[float]):
    return make_maplet(
        body,
        TO_SPC,
        "TR0001",
        direction=np.array(direction),
        settings=settings,
        generator=stream(1, "maplet"),
    )


def test_without_errors_a_maplet_is_the_truth_in_its_frame(body: TruthBody) -> None:
    maplet = _maplet(body, EXACT, [0.5, 0.7, 0.3])
    points = TO_SPC.inverse().apply(maplet.points().reshape(-1, 3))
    np.testing.assert_allclose(
        np.linalg.norm(points, axis=1), body.radius(points), rtol=0, atol=1e-8
    )
    truth = heights_in_frame(body, maplet.grid, TO_SPC)
    np.testing.assert_allclose(maplet.height, truth, rtol=0, atol=1e-8)
    assert maplet.height[16, 16] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_array_equal(maplet.sigma, 0.0)


def test_the_errors_are_as_large_as_stated(body: TruthBody) -> None:
    wrong, pulls = [], []
    for number, direction in enumerate(lattice(14)[:10]):
        maplet = make_maplet(
            body,
            TO_SPC,
            "TR0001",
            direction=direction,
            settings=replace(SMALL, center_sigma=0.0),
            generator=stream(number, "maplet"),
        )
        error = maplet.height - heights_in_frame(body, maplet.grid, TO_SPC)
        wrong.append(error)
        pulls.append(error / maplet.sigma)
    # The noise is 10 cm; smoothing adds to it at boulders, and the sigma follows.
    assert 0.09 < np.median(np.abs(wrong)) / 0.6745 < 0.13
    assert 0.8 < np.std(pulls) < 1.3


def test_centres_err_by_their_sigma(body: TruthBody) -> None:
    settings = replace(EXACT, center_sigma=0.06)
    maplets = [
        make_maplet(
            body,
            TO_SPC,
            "TR0001",
            direction=np.array([0.5, 0.7, 0.3]),
            settings=settings,
            generator=stream(number, "maplet"),
        )
        for number in range(60)
    ]
    exact = _maplet(body, EXACT, [0.5, 0.7, 0.3])
    errors = np.array([maplet.grid.center for maplet in maplets]) - exact.grid.center
    assert np.std(errors) == pytest.approx(0.06, rel=0.2)
    np.testing.assert_array_equal(maplets[0].center_sigma, 0.06)


def test_the_dark_pole_is_missing_and_twilight_is_noisy(body: TruthBody) -> None:
    maplet = _maplet(body, SMALL, [0.0, 0.01, -1.0])
    places = TO_SPC.inverse().apply(maplet.grid.points(np.zeros(maplet.grid.shape)))
    south = np.degrees(np.arctan2(-places[..., 2], np.hypot(places[..., 0], places[..., 1])))
    assert not maplet.valid[south > 79.0].any()
    assert maplet.valid[south < 76.0].all()
    twilight = maplet.valid & (south > 71.5)
    assert np.all(maplet.sigma[twilight] >= 0.4)
    assert np.all(maplet.sigma[south < 68.0] < 0.4)


def test_noise_has_rms_1_and_the_stated_correlation() -> None:
    samples = np.array([correlated_noise((99, 99), 5.0, stream(k, "noise")) for k in range(30)])
    assert samples.std() == pytest.approx(1.0, rel=0.03)
    at_five = np.mean(samples[:, :, 5:] * samples[:, :, :-5])
    assert at_five == pytest.approx(np.exp(-1.0), abs=0.06)


def test_boulders_come_out_short() -> None:
    m, n = np.meshgrid(np.arange(-20.0, 21.0), np.arange(-20.0, 21.0), indexing="ij")
    boulder = np.sqrt(np.clip(9.0 - (m**2 + n**2), 0.0, None)) * 0.5
    height, loss = smoothed(boulder, SMALL)
    assert height.max() < 0.9 * boulder.max()
    assert loss[20, 20] > 0.05
    np.testing.assert_allclose(height[:5], 0.0, atol=1e-6)


def test_a_plane_is_not_changed_by_smoothing() -> None:
    m, n = np.meshgrid(np.arange(40.0), np.arange(40.0), indexing="ij")
    plane = 0.1 * m - 0.2 * n
    inner = (slice(12, -12),) * 2
    np.testing.assert_allclose(smoothed(plane, SMALL)[0][inner], plane[inner], atol=1e-3)


def test_the_shape_of_a_sphere_is_a_moved_sphere() -> None:
    shape = spc_shape(TruthBody(BodySettings.sphere(40.0)), TO_SPC, 8)
    distance = np.linalg.norm(shape.vertices - TO_SPC.translation, axis=-1)
    np.testing.assert_allclose(distance, 40.0 * 0.99975, rtol=0, atol=1e-10)
    assert shape.mesh().volume > 0


@pytest.mark.parametrize("wrong", [{"gsd": 0.0}, {"noise": -1.0}, {"dark_latitude_deg": 60.0}])
def test_settings_out_of_range_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(SettingsError):
        SolutionSettings(**wrong)
