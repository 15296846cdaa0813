"""Landmarks: seen where geometry predicts, measured as exactly as stated."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from spcola.camera import ImagePoint, project_image
from spcola.control import overlaps_of
from spcola.grids import MapletGrid
from spcola.math import Similarity, lattice
from spcola.truth.body import stream
from spcola.truth.campaign import PassSettings, plan_passes, stations_of_pass
from spcola.truth.campaign.cameras import framing_camera
from spcola.truth.campaign.states import SolvedState, StateSettings, make_state
from spcola.truth.campaign.stations import Station
from spcola.truth.sampled import SampledSurface
from spcola.truth.solution import landmarks_of, measure_landmarks

RADIUS = 100.0
TO_SPC = Similarity.from_rotation_vector([1e-4, -2e-4, 3e-4], [0.07, -0.05, 0.04], 0.99975)
QUIET = StateSettings(
    position_sigma=0.0, pixel_sigma=0.0, most_emission_deg=89.0, most_incidence_deg=89.0
)
TOP = np.array([1.0, 0.0, 0.0])


@dataclass
class Mountain:
    """A sphere with one mountain, 10 m high and some 5 m wide, on +X."""

    height: float = 10.0

    def radius(self, directions: np.ndarray) -> np.ndarray:
        unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        away = RADIUS * np.linalg.norm(unit - TOP, axis=1)
        return RADIUS + self.height * np.exp(-0.5 * (away / 2.5) ** 2)


@dataclass
class Solved:
    name: str
    grid: MapletGrid
    center_sigma: np.ndarray
    true_center: np.ndarray


@pytest.fixture(scope="module")
def sphere() -> SampledSurface:
    return SampledSurface(Mountain(0.0), 0.5)


@pytest.fixture(scope="module")
def mountain() -> SampledSurface:
    return SampledSurface(Mountain(), 0.25)


def _maplets(directions: np.ndarray, gsd: float = 0.5, center_sigma: float = 0.0) -> list[Solved]:
    generator = stream(1, "centres")
    solved = []
    for number, direction in enumerate(directions):
        center = Mountain(0.0).radius(direction[None])[0] * direction
        wrong = TO_SPC.apply(center) + center_sigma * generator.normal(size=3)
        grid = MapletGrid.facing(wrong, TO_SPC.turn(direction), gsd, 8)
        solved.append(Solved(f"TR{number:04d}", grid, np.full(3, center_sigma), center))
    return solved


def _state(position, sun, *, target=None, settings: StateSettings = QUIET) -> SolvedState:
    place = np.array(position, dtype=float)
    target = RADIUS * place / np.linalg.norm(place) if target is None else target
    camera = framing_camera("MapCam")
    station = Station("I1", "P", 6.0e8, place, target, camera, 6.4, np.zeros(3))
    return make_state(
        station, TO_SPC, np.array(sun), settings=settings, generator=stream(1, "state")
    )


def _measure(state, maplets, surface, settings: StateSettings = QUIET, seed: int = 1):
    generator = stream(seed, "points")
    return measure_landmarks(state, maplets, surface, settings=settings, generator=generator)


def test_on_a_sphere_the_limits_of_emission_and_incidence_decide(sphere: SampledSurface) -> None:
    maplets = _maplets(lattice(400))
    sun = np.array([np.cos(0.9), np.sin(0.9), 0.0])
    settings = replace(QUIET, most_emission_deg=65.0, most_incidence_deg=80.0)
    state = _state([4000.0, 0.0, 0.0], sun)
    seen = {point.name for point in _measure(state, maplets, sphere, settings)}
    expected = set()
    for solved in maplets:
        normal = solved.true_center / RADIUS
        toward = np.array([4000.0, 0.0, 0.0]) - solved.true_center
        emission = np.degrees(np.arccos(normal @ toward / np.linalg.norm(toward)))
        incidence = np.degrees(np.arccos(normal @ sun))
        if emission < 65.0 and incidence < 80.0:
            expected.add(solved.name)
    assert seen == expected
    assert len(seen) > 40


def test_pixels_are_those_of_the_true_centre_in_the_true_state(sphere: SampledSurface) -> None:
    maplets = _maplets(lattice(400), center_sigma=0.06)
    state = _state([1000.0, 300.0, 200.0], TOP, settings=StateSettings())
    for point in _measure(state, maplets, sphere):
        solved = maplets[int(point.name[2:])]
        exact = project_image(state.truth, solved.true_center)
        assert (point.pixel, point.line) == pytest.approx(exact, abs=0.00501)


def test_a_mountain_hides_what_lies_behind_it(mountain, sphere) -> None:
    """From 16° above its horizon the ground just behind it is hidden, that before it is not."""
    behind, before = ([np.cos(0.08), side * np.sin(0.08), 0.0] for side in (-1.0, 1.0))
    maplets = _maplets(np.array([behind, before]))
    camera = 1500.0 * np.array([np.sin(0.35), np.cos(0.35), 0.0])
    state = _state(camera, TOP, target=RADIUS * TOP)
    assert [p.name for p in _measure(state, maplets, sphere)] == ["TR0000", "TR0001"]
    assert [p.name for p in _measure(state, maplets, mountain)] == ["TR0001"]


def test_a_mountain_shadows_what_lies_behind_it(mountain, sphere) -> None:
    behind, before = ([np.cos(0.08), side * np.sin(0.08), 0.0] for side in (-1.0, 1.0))
    maplets = _maplets(np.array([behind, before]))
    state = _state([1500.0, 0.0, 0.0], [np.sin(0.35), np.cos(0.35), 0.0])
    assert [p.name for p in _measure(state, maplets, sphere)] == ["TR0000", "TR0001"]
    assert [p.name for p in _measure(state, maplets, mountain)] == ["TR0001"]


def test_a_centre_below_the_ground_is_seen_as_the_ground_above_it(mountain) -> None:
    """The solution's boulders are short: its centres may lie inside the true ones."""
    maplets = _maplets(TOP[None])
    assert maplets[0].true_center @ TOP == pytest.approx(RADIUS)
    assert _measure(_state([1500.0, 0.0, 0.0], TOP), maplets, mountain)


def test_what_lies_outside_the_frame_or_is_too_small_is_not_seen(sphere) -> None:
    maplets = _maplets(lattice(400))
    near = _state([300.0, 0.0, 0.0], TOP)
    seen = _measure(near, maplets, sphere)
    assert 0 < len(seen) < 20
    for point in seen:
        assert 1.0 < point.pixel < 1024.0
        assert 1.0 < point.line < 1024.0
    # A pixel of 68 µrad is one and a half GSDs of 0.5 m at 11 km.
    assert _measure(_state([11_100.0, 0.0, 0.0], TOP), maplets, sphere)
    assert not _measure(_state([11_200.0, 0.0, 0.0], TOP), maplets, sphere)


def test_residuals_say_how_wrong_centres_and_states_are(sphere) -> None:
    """FormU means something: noise, centres and states, each as large as stated."""
    settings = StateSettings()
    passes = PassSettings(count=12, days=3, nearest=950.0, farthest=1050.0)
    maplets = _maplets(lattice(2000), center_sigma=0.06)
    residuals = []
    for at in plan_passes(passes, stream(1, "passes")):
        for station in stations_of_pass(at, 2, radius=RADIUS):
            generator = stream(1, station.name)
            state = make_state(
                station, TO_SPC, passes.sun(station.time), settings=settings, generator=generator
            )
            for point in measure_landmarks(
                state, maplets, sphere, settings=settings, generator=generator
            ):
                center = maplets[int(point.name[2:])].grid.center
                predicted = project_image(state.solved, center)
                residuals.append([predicted[0] - point.pixel, predicted[1] - point.line])
    # A pixel is some 6.3 cm: 0.3 px of noise, 0.06 m of centres, and up to 50 m from the target
    # some 0.2 m · 50 m / 925 m / 6.3 cm of what turning cannot make good.
    assert len(residuals) > 1000
    pixel = 68.0e-6 * 925.0
    assert np.std(residuals) == pytest.approx(np.hypot(0.3, 0.06 / pixel), rel=0.05)


def test_landmarks_list_their_pictures_in_the_order_of_the_images(sphere) -> None:
    maplets = _maplets(lattice(400))
    states = [_state([1000.0, y, 0.0], TOP) for y in (-100.0, 0.0, 100.0)]
    images = [
        replace(s.solved, name=f"I{k}", landmarks=_measure(s, maplets, sphere))
        for k, s in enumerate(states)
    ]
    landmarks = landmarks_of(maplets, images, rms=0.3)
    assert [k.name for k in landmarks] == [s.name for s in maplets]
    from_images = [
        (m.name, ImagePoint(i.name, m.pixel, m.line)) for i in images for m in i.landmarks
    ]
    from_landmarks = [(k.name, p) for k in landmarks for p in k.pictures]
    assert sorted(from_images, key=str) == sorted(from_landmarks, key=str)
    assert any([p.name for p in k.pictures] == ["I0", "I1", "I2"] for k in landmarks)


def test_overlaps_are_the_projected_neighbours() -> None:
    maplets = _maplets(lattice(2000), gsd=1.0)
    found = overlaps_of({m.name: m.grid for m in maplets})
    by_name = {m.name: m for m in maplets}
    for maplet, overlaps in list(zip(maplets, found, strict=True))[::101]:
        expected = set()
        for other in maplets:
            x, y, _ = maplet.grid.project(other.grid.center)
            near = max(abs(float(x)), abs(float(y))) < 12.0
            if near and other is not maplet and other.grid.uz @ maplet.grid.uz > 0.5:
                expected.add(other.name)
        assert {o.name for o in overlaps} == expected
        assert expected
        for overlap in overlaps:
            x, y, height = maplet.grid.project(by_name[overlap.name].grid.center)
            assert (overlap.x, overlap.y) == pytest.approx((x, y), abs=0.00501)
            assert overlap.h == pytest.approx(height, abs=0.00501)


def test_nothing_has_no_landmarks(sphere) -> None:
    assert _measure(_state([1000.0, 0.0, 0.0], TOP), [], sphere) == ()
    assert landmarks_of([], [], rms=0.3) == []
