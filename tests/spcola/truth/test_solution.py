"""The SPC solution: exact without errors, and as wrong as stated with them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from spcola.errors import SettingsError
from spcola.grids import MapletGrid
from spcola.math import Similarity, lattice
from spcola.truth.body import BodySettings, TruthBody, stream
from spcola.truth.sampled import LightMap
from spcola.truth.sampled.cube import Tiling, tile_directions
from spcola.truth.solution import (
    SolutionSettings,
    heights_in_frame,
    make_maplet,
    maplet_directions,
    spc_shape,
)
from spcola.truth.solution.degradation import Darkness, Smoothing
from spcola.truth.solution.solution import SolvedMaplet

SMALL = SolutionSettings(gsd=0.5, half_size=16, maplets=40)
EXACT = replace(
    SMALL, noise=0.0, center_sigma=0.0, albedo_noise=0.0, softness=Smoothing(smoothing=0.0)
)
TO_SPC = Similarity.from_rotation_vector([1e-4, -2e-4, 3e-4], [0.07, -0.05, 0.04], 0.99975)
ASIDE = [0.5, 0.7, 0.3]


def _light(share: Callable[[np.ndarray], Any]) -> LightMap:
    """Return the light map of a share by unit directions."""
    tiling = Tiling.of(1, 256, 0.0)
    directions = tile_directions(tiling, np.arange(6))
    shares = np.broadcast_to(share(directions), len(directions)).astype(np.float32)
    return LightMap(tiling, shares.reshape(6, -1))


DAY, NIGHT = _light(lambda _: 0.45), _light(lambda _: 0.0)


@pytest.fixture(scope="module")
def body() -> TruthBody:
    return TruthBody(BodySettings(seed=7, radius=40.0))


@pytest.fixture(scope="module")
def sphere() -> TruthBody:
    return TruthBody(BodySettings.sphere(40.0))


def _maplet(
    body: TruthBody,
    settings: SolutionSettings,
    direction: Any = ASIDE,
    light: LightMap = DAY,
    seed: int = 1,
) -> SolvedMaplet:
    return make_maplet(
        body,
        TO_SPC,
        "TR0001",
        direction=np.asarray(direction, dtype=np.float64),
        light=light,
        settings=settings,
        generator=stream(seed, "maplet"),
    )


def _errors(body: TruthBody, solved: SolvedMaplet) -> np.ndarray:
    return solved.maplet.height - heights_in_frame(body, solved.maplet.grid, TO_SPC)


def test_without_errors_a_maplet_is_the_truth_in_its_frame(body: TruthBody) -> None:
    solved = _maplet(body, EXACT)
    maplet = solved.maplet
    points = TO_SPC.inverse().apply(maplet.points().reshape(-1, 3))
    np.testing.assert_allclose(
        np.linalg.norm(points, axis=1), body.radius(points), rtol=0, atol=1e-8
    )
    np.testing.assert_allclose(_errors(body, solved), 0.0, rtol=0, atol=1e-8)
    assert maplet.height[16, 16] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_array_equal(maplet.sigma, 0.0)
    np.testing.assert_allclose(TO_SPC.apply(solved.true_center), maplet.grid.center, atol=1e-9)
    expected = body.albedo(points).reshape(maplet.albedo.shape)
    np.testing.assert_allclose(maplet.albedo, expected, rtol=0, atol=1e-6)


def test_in_good_light_the_errors_are_as_large_as_stated(body: TruthBody) -> None:
    wrong, pulls = [], []
    for number, direction in enumerate(lattice(14)):
        solved = _maplet(body, replace(SMALL, center_sigma=0.0), direction, seed=number)
        wrong.append(_errors(body, solved))
        pulls.append(wrong[-1] / solved.maplet.sigma)
    # The noise is 10 cm; smoothing adds to it at boulders, and the sigma follows.
    assert 0.09 < np.median(np.abs(wrong)) / 0.6745 < 0.125
    assert 0.85 < np.std(pulls) < 1.15
    assert np.mean(np.abs(pulls) < 1.0) == pytest.approx(0.683, abs=0.06)


def test_centres_err_by_their_sigma_and_stand_for_a_point_of_the_surface(body: TruthBody) -> None:
    settings = replace(SMALL, softness=Smoothing(smoothing=0.0))
    solved = [_maplet(body, settings, seed=number) for number in range(60)]
    truth = solved[0].true_center
    assert np.linalg.norm(truth) == pytest.approx(body.radius(truth[None])[0], abs=1e-8)
    errors = []
    for one in solved:
        np.testing.assert_array_equal(one.true_center, truth)
        errors.append(one.maplet.grid.center - TO_SPC.apply(truth))
        # The height at the centre is that of the noise alone: the centre's error is in the frame.
        assert abs(one.maplet.height[16, 16]) < 5 * settings.noise
    assert np.std(errors) == pytest.approx(0.06, rel=0.15)
    np.testing.assert_array_equal(solved[0].maplet.center_sigma, 0.06)


def test_in_poor_light_the_noise_grows_to_its_factor(sphere: TruthBody) -> None:
    settings = replace(SMALL, darkness=Darkness(poor=0.3, dark=0.1, noise=4.0))
    spread = {}
    for share in (0.4, 0.3, 0.2, 0.1):
        light = _light(lambda _, share=share: share)
        solved = [_maplet(sphere, settings, light=light, seed=k) for k in range(12)]
        spread[share] = np.std([_errors(sphere, one) for one in solved])
        expected = 0.1 * (1.0 + 3.0 * np.clip(1.0 - share / 0.3, 0.0, 1.0))
        assert np.median(solved[0].maplet.sigma) == pytest.approx(expected, rel=0.01)
    assert spread[0.3] == pytest.approx(spread[0.4], rel=0.15)
    assert spread[0.2] == pytest.approx(0.2, rel=0.15)
    assert spread[0.1] == pytest.approx(0.3, rel=0.15)


def test_in_the_dark_heights_drift_by_decimetres_over_tens_of_cells(sphere: TruthBody) -> None:
    settings = replace(EXACT, darkness=Darkness(reach=np.inf))
    drifts = [_maplet(sphere, settings, d, NIGHT) for d in lattice(80)]
    truth = heights_in_frame(sphere, drifts[0].maplet.grid, TO_SPC)
    assert np.isfinite(truth).all()
    errors = np.array([_errors(sphere, one) for one in drifts])
    rms = np.sqrt(np.mean(errors**2))
    assert rms == pytest.approx(settings.darkness.drift, rel=0.25)
    assert 1.0 < np.abs(errors).max() < 3.0
    for one in drifts:
        np.testing.assert_allclose(one.maplet.sigma, settings.darkness.drift, rtol=1e-3)
        assert np.all(one.maplet.center_sigma <= settings.darkness.drift)
        up = one.maplet.grid.uz @ (one.maplet.grid.center - TO_SPC.apply(one.true_center))
        # The centre drifts with its surface.
        assert _errors(sphere, one)[16, 16] == pytest.approx(up, abs=0.02)

    def correlation(cells: int) -> float:
        return float(np.mean(errors[:, :, cells:] * errors[:, :, :-cells]) / rms**2)

    assert correlation(3) > 0.9
    assert correlation(10) > 0.4
    assert abs(correlation(30)) < 0.3


def test_maplets_that_share_dark_ground_share_its_drift(sphere: TruthBody) -> None:
    settings = replace(EXACT, darkness=Darkness(reach=np.inf))
    one = _maplet(sphere, settings, [1.0, 0.0, 0.0], NIGHT, seed=1).maplet
    other = _maplet(sphere, settings, [1.0, 0.1, 0.0], NIGHT, seed=2).maplet
    radius = [np.linalg.norm(m.points() - TO_SPC.translation, axis=-1) for m in (one, other)]
    x, y, _ = other.grid.project(one.points())
    column, row = np.round(x).astype(int) + 16, np.round(y).astype(int) + 16
    both = (column >= 0) & (column <= 32) & (row >= 0) & (row <= 32)
    apart = radius[0][both] - radius[1][row[both], column[both]]
    assert both.sum() > 500
    assert np.std(apart) < 0.25 * np.std(radius[0][both])


def test_heights_end_where_the_light_is_too_far(sphere: TruthBody) -> None:
    # Dark south of −70° of latitude; a cell of this sphere is 0.72°.
    pole = _light(lambda d: np.where(d[:, 2] < -np.sin(np.radians(70.0)), 0.0, 0.4))
    spans = {}
    for reach in (0.0, 10.0, 20.0, np.inf):
        settings = replace(SMALL, half_size=30, darkness=Darkness(reach=reach))
        solved = _maplet(sphere, settings, [0.0, 0.0, -1.0], pole)
        steps = np.hypot(*np.meshgrid(solved.maplet.grid.offsets, solved.maplet.grid.offsets))
        unknown = ~solved.maplet.valid
        spans[reach] = steps[unknown].max() if unknown.any() else 0.0
        assert unknown[steps < spans[reach] - 3.0].all()
        assert np.isfinite(solved.maplet.sigma).all()
    edge = 40.0 * np.sin(np.radians(20.0)) / 0.5
    assert spans[0.0] == pytest.approx(edge, abs=2.0)
    assert spans[10.0] == pytest.approx(edge - 10.0, abs=2.0)
    assert spans[20.0] == pytest.approx(edge - 20.0, abs=2.0)
    assert spans[np.inf] == 0.0


def test_light_beyond_the_edge_of_a_maplet_counts(sphere: TruthBody) -> None:
    """Two maplets give heights to the same ground, though one of them holds no lit ground."""
    pole = _light(lambda d: np.where(d[:, 2] < -np.sin(np.radians(70.0)), 0.0, 0.4))
    settings = replace(SMALL, half_size=10, darkness=Darkness(reach=20.0))
    small = _maplet(sphere, settings, [0.0, 0.0, -1.0], pole).maplet
    large = _maplet(sphere, replace(settings, half_size=40), [0.0, 0.0, -1.0], pole).maplet
    inner = (slice(30, 51),) * 2
    assert 0 < small.valid.sum() < small.valid.size
    assert np.mean(small.valid != large.valid[inner]) < 0.1


def test_maplets_cover_the_whole_body_with_the_stated_overlap() -> None:
    settings = SolutionSettings()
    assert 1550 < settings.count(245.0) < 1650
    ball = TruthBody(BodySettings.sphere(60.0))
    directions = maplet_directions(ball, settings)
    assert len(directions) == settings.count(60.0)
    points = 60.0 * lattice(20_000)
    covered = np.zeros(len(points))
    for direction in directions:
        grid = MapletGrid.facing(60.0 * direction, direction, settings.gsd, settings.half_size)
        x, y, height = grid.project(points)
        inside = np.maximum(np.abs(x), np.abs(y)) <= grid.half_size
        covered += inside & (height > -30.0)
    assert covered.min() >= 1
    # Each point lies in 1 / (1 − overlap)² of them, on a plane.
    assert covered.mean() == pytest.approx(1.0 / 0.63**2, rel=0.1)
    assert len(maplet_directions(ball, SMALL)) == 40


def test_the_shape_of_a_sphere_is_a_moved_sphere(sphere: TruthBody) -> None:
    shape = spc_shape(sphere, TO_SPC, 8)
    distance = np.linalg.norm(shape.vertices - TO_SPC.translation, axis=-1)
    np.testing.assert_allclose(distance, 40.0 * 0.99975, rtol=0, atol=1e-10)
    assert shape.mesh().volume > 0


def test_a_shadow_that_ends_with_a_face_leaves_the_shape_closed(sphere: TruthBody) -> None:
    """Light is known face by face, and rounding puts the labels of one vertex on two of them."""
    shares = np.tile([[0.0], [0.45]], (3, DAY.shares.shape[1])).astype(np.float32)
    shape = spc_shape(sphere, TO_SPC, 31, light=LightMap(DAY.tiling, shares), settings=SMALL)
    assert shape.mesh().volume > 0


def test_in_the_dark_the_shape_drifts_as_the_maplets_do(sphere: TruthBody) -> None:
    settings = replace(EXACT, gsd=0.1)
    half = _light(lambda directions: np.where(directions[:, 2] > 0.0, 0.45, 0.0))
    shape = spc_shape(sphere, TO_SPC, 24, light=half, settings=settings)
    back = TO_SPC.inverse()
    places = back.apply(shape.vertices.reshape(-1, 3))
    drift = np.linalg.norm(places, axis=1) - 40.0
    north, south = places[:, 2] > 3.0, places[:, 2] < -3.0
    np.testing.assert_allclose(drift[north], 0.0, atol=1e-9)
    assert np.sqrt(np.mean(drift[south] ** 2)) == pytest.approx(0.6, rel=0.25)
    for number in np.flatnonzero(south)[::97]:
        maplet = _maplet(sphere, settings, places[number], half).maplet
        centre = np.linalg.norm(back.apply(maplet.grid.center)) - 40.0
        assert centre == pytest.approx(drift[number], abs=0.01)


@pytest.mark.parametrize(
    "wrong", [{"gsd": 0.0}, {"noise": -1.0}, {"maplets": 2}, {"overlap": 1.0}, {"correlation": 0.0}]
)
def test_settings_out_of_range_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(SettingsError):
        SolutionSettings(**wrong)
