"""States: truth, solution and navigation differ by what is stated, and by nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from spcola.camera import project_image, ray
from spcola.errors import SettingsError
from spcola.math import Similarity
from spcola.navigation import et_from_utc
from spcola.truth.body import stream
from spcola.truth.campaign.cameras import framing_camera
from spcola.truth.campaign.states import SolvedState, StateSettings, make_state
from spcola.truth.campaign.stations import Station

TO_SPC = Similarity.from_rotation_vector([1e-4, -2e-4, 3e-4], [0.07, -0.05, 0.04], 0.99975)
SUN = np.array([0.8, 0.0, 0.6])
SETTINGS = StateSettings()
EXACT = StateSettings(position_sigma=0.0, pixel_sigma=0.0, nominal_pointing_sigma=0.0)


def _station(direction=(0.6, -0.2, 0.4), **changes) -> Station:
    toward = np.array(direction) / np.linalg.norm(direction)
    values = {
        "name": "DS01I0001",
        "phase": "DS",
        "time": 615_211_300.25,
        "position": 1000.0 * toward,
        "target": 245.0 * toward,
        "camera": framing_camera("MapCam"),
        "nominal_sigma": 6.4,
        "velocity": np.array([0.1, -0.2, 0.05]),
    }
    return Station(**values | changes)


def _state(station: Station, settings: StateSettings = SETTINGS, seed: int = 1) -> SolvedState:
    return make_state(station, TO_SPC, SUN, settings=settings, generator=stream(seed, "state"))


def _many(station: Station, settings: StateSettings = SETTINGS) -> list[SolvedState]:
    generator = stream(3, "state")
    return [
        make_state(station, TO_SPC, SUN, settings=settings, generator=generator) for _ in range(400)
    ]


def test_the_true_state_is_the_station() -> None:
    station = _station()
    truth = _state(station).truth
    np.testing.assert_allclose(truth.position, station.position)
    assert project_image(truth, station.target) == pytest.approx((512.5, 512.5), abs=1e-9)
    np.testing.assert_array_equal(truth.sun, SUN)
    assert et_from_utc(truth.utc) == pytest.approx(station.time, abs=1e-3)


def test_without_errors_all_three_see_the_same() -> None:
    state = _state(_station(nominal_sigma=0.0), EXACT)
    ground = 245.0 * np.array([[0.7, -0.2, 0.5], [0.6, -0.3, 0.4], [0.5, 0.0, 0.5]])
    true = np.array(project_image(state.truth, ground))
    solved = np.array(project_image(state.solved, TO_SPC.apply(ground)))
    np.testing.assert_allclose(solved, true, atol=1e-8)
    np.testing.assert_allclose(state.nominal.scobj, state.solved.scobj, atol=1e-9)
    np.testing.assert_allclose(state.nominal.axes, state.solved.axes, atol=1e-12)
    np.testing.assert_allclose(state.solved.sun, TO_SPC.turn(SUN), atol=1e-15)
    np.testing.assert_allclose(
        state.nominal.velocity, 0.99975 * TO_SPC.turn([0.1, -0.2, 0.05]), atol=1e-15
    )


def test_solved_places_are_off_by_their_sigma() -> None:
    station = _station()
    errors = np.array([s.solved.position for s in _many(station)]) - TO_SPC.apply(station.position)
    np.testing.assert_allclose(errors.std(axis=0), 0.20, rtol=0.1)
    np.testing.assert_allclose(errors.mean(axis=0), 0.0, atol=0.03)
    np.testing.assert_array_equal(_state(station).solved.scobj_sigma, 0.20)


@pytest.mark.parametrize("direction", [(0.6, -0.2, 0.4), (0.01, 0.0, 1.0), (0.0, 0.0, -1.0)])
def test_solved_axes_look_at_the_same_ground(direction) -> None:
    """At the boresight exactly; within 100 m of it, 0.2 m of 755 m leave under a pixel.

    Over the poles too, where axes drawn from the equator would turn about the boresight.
    """
    station = _station(direction)
    center = ray(_state(station, EXACT).truth, 512.5, 512.5)
    generator = np.random.default_rng(5)
    across = generator.uniform(-50.0, 50.0, size=(20, 3))
    ground = station.target + across - (across @ center)[:, None] * center
    for state in _many(station)[:40]:
        target = project_image(state.solved, TO_SPC.apply(station.target))
        assert target == pytest.approx((512.5, 512.5), abs=1e-6)
        true = np.array(project_image(state.truth, ground))
        solved = np.array(project_image(state.solved, TO_SPC.apply(ground)))
        assert np.max(np.abs(solved - true)) < 1.5


def test_each_nominal_deviation_is_capped_at_one_sigma() -> None:
    """Weirich et al., section 2.6: about 70 % within 1 σ, the rest just at it."""
    for sigma in (400.0, 100.0, 6.4):
        station = _station(nominal_sigma=sigma)
        places = np.array([-s.nominal.scobj for s in _many(station)])
        distance = np.linalg.norm(places - TO_SPC.apply(station.position), axis=1)
        assert distance.max() <= sigma * (1.0 + 1e-9)
        at_cap = distance > sigma * (1.0 - 1e-9)
        assert np.mean(at_cap) == pytest.approx(0.317, abs=0.06)
        state = _state(station)
        np.testing.assert_array_equal(state.nominal.scobj_sigma, sigma)


def test_nominal_axes_turn_by_their_sigma() -> None:
    turns = []
    for state in _many(_station()):
        turn = state.nominal.axes @ TO_SPC.turn(state.truth.axes).T
        turns.append([turn[1, 2], turn[2, 0], turn[0, 1]])
    np.testing.assert_allclose(np.std(turns, axis=0), 1e-4, rtol=0.1)
    np.testing.assert_array_equal(_state(_station()).nominal.pointing_sigma, 1e-4)


def test_a_seed_gives_the_same_states() -> None:
    first, again, other = (_state(_station(), seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.solved.scobj, again.solved.scobj)
    np.testing.assert_array_equal(first.nominal.axes, again.nominal.axes)
    assert np.any(first.solved.scobj != other.solved.scobj)


@pytest.mark.parametrize("bits", [8, 12, 14, 16])
def test_thresholds_follow_the_bit_depth(bits: int) -> None:
    generator = stream(1, "state")
    state = make_state(_station(), TO_SPC, SUN, settings=SETTINGS, generator=generator, bits=bits)
    low, high = state.truth.thresholds
    assert 0 < low < 0.01 * high
    assert high == 2**bits - 2
    assert state.solved.thresholds == state.truth.thresholds


@pytest.mark.parametrize(
    "wrong",
    [
        {"position_sigma": -1.0},
        {"nominal_pointing_sigma": -1.0},
        {"most_emission_deg": 91.0},
        {"coarsest": 0.0},
        {"per_pass": 0},
    ],
)
def test_settings_out_of_range_are_refused(wrong) -> None:
    with pytest.raises(SettingsError):
        replace(SETTINGS, **wrong)


def test_a_camera_distorts_the_image_and_the_solution_uses_it() -> None:
    bent = replace(EXACT, distortion=(2e-5, 0.0, 0.0, 0.0))
    straight, curved = _state(_station(), EXACT), _state(_station(), bent)
    ground = 245.0 * np.array([[0.6, -0.25, 0.44]])
    moved = np.subtract(
        project_image(curved.truth, ground), project_image(straight.truth, ground)
    ).ravel()
    place = np.subtract(project_image(straight.truth, ground), 512.5).ravel()
    # Owen's e2 moves what is r mm from the axis outward by e2 r³ mm.
    pixel_mm = 0.0085
    np.testing.assert_allclose(moved, 2e-5 * pixel_mm**2 * (place @ place) * place, rtol=1e-3)
    assert np.hypot(*moved) > 0.01
    np.testing.assert_array_equal(curved.solved.camera.distortion, bent.distortion)
