"""Stations: the phases of the published campaign, and geometry by formulas."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from spcola.camera import SpcImage, project_image
from spcola.errors import SettingsError
from spcola.truth.campaign import (
    CampaignSettings,
    Pass,
    PassSettings,
    plan_stations,
    stations_of_pass,
)
from spcola.truth.campaign.cameras import framing_camera, looking, turned_to
from spcola.truth.campaign.campaign import Leg, approach_legs, place_of
from spcola.truth.campaign.stations import Station, ground_toward

PASSES = PassSettings()
NADIR = Leg("DS", 0, 36, "PolyCam", (10.0, 10.0), (38.0, 38.0), (3800.0, 3800.0))
ORIGIN = np.zeros(3)


@pytest.fixture(scope="module")
def campaign() -> CampaignSettings:
    return CampaignSettings.of_phases()


@pytest.fixture(scope="module")
def stations(campaign: CampaignSettings) -> list[Station]:
    return plan_stations(campaign, PASSES)


def _plan(*legs: Leg, **settings) -> list[Station]:
    return plan_stations(CampaignSettings(legs, **settings), PASSES)


def _distance(stations: list[Station]) -> np.ndarray:
    return np.linalg.norm([s.position for s in stations], axis=1)


def _phase_angle_deg(stations: list[Station]) -> np.ndarray:
    suns = np.array([PASSES.sun(s.time) for s in stations])
    toward = np.array([s.position for s in stations]) / _distance(stations)[:, None]
    return np.degrees(np.arccos(np.sum(suns * toward, axis=1)))


def _image(station: Station) -> SpcImage:
    return SpcImage(
        station.name,
        "",
        station.camera,
        -station.position,
        looking(station.position, station.target),
        PASSES.sun(station.time),
    )


@pytest.mark.parametrize(
    ("phase", "count", "ranges_km", "angles_deg", "best_gsd", "sigma"),
    [
        ("AP", 927, (30.0, 140.5), (4, 41), 0.41, 400.0),
        ("PS", 877, (8.9, 11.1), (37, 92), 0.12, 100.0),
        ("DS", 3265, (3.8, 3.8), (44, 52), 0.05, 6.4),
    ],
)
def test_the_phases_are_those_of_the_paper(
    stations, phase, count, ranges_km, angles_deg, best_gsd, sigma
) -> None:
    """Weirich et al., Table 1; best GSD and phase angle to the digits printed there."""
    chosen = [s for s in stations if s.phase == phase]
    assert len(chosen) == count
    distance = _distance(chosen) / 1000.0
    assert distance.min() == pytest.approx(ranges_km[0], rel=2e-3)
    assert distance.max() == pytest.approx(ranges_km[1], rel=2e-3)
    angle = _phase_angle_deg(chosen)
    assert angles_deg[0] - 0.5 <= angle.min() <= angle.max() <= angles_deg[1] + 0.5
    gsd = min(
        s.camera.pixel_angle * np.linalg.norm(s.position - s.target)
        for s in chosen
        if s.camera.focal_length_mm > 600
    )
    assert gsd == pytest.approx(best_gsd, rel=0.05)
    assert {s.nominal_sigma for s in chosen} == {sigma}


def test_names_are_unique_and_fit(stations) -> None:
    names = [s.name for s in stations]
    assert len(set(names)) == len(names)
    assert max(map(len, names)) <= 12


def test_the_approach_follows_a_rotation_a_day_in_steps_of_10_degrees(stations) -> None:
    day = [s for s in stations if s.name.startswith("AP01")]
    longitudes = np.unwrap([np.arctan2(s.position[1], s.position[0]) for s in day])
    np.testing.assert_allclose(np.degrees(np.diff(longitudes)), -10.0, atol=0.05)
    grid = [s for s in stations if s.name.startswith("AP06")][:4]
    # Four frames that overlap by a tenth meet at the body's centre.
    places = [project_image(_image(s), ORIGIN) for s in grid]
    shift = np.array(places) - 512.5
    np.testing.assert_allclose(np.abs(shift), 0.45 * 1024, rtol=0.01)
    assert len({tuple(np.sign(s)) for s in shift}) == 4


def test_the_polar_passes_cross_the_poles_the_right_way(stations) -> None:
    for prefixes, side, way in (
        (("PS10", "PS11", "PS12"), 1.0, -1.0),
        (("PS14", "PS15", "PS16"), -1.0, 1.0),
    ):
        chosen = [s for s in stations if s.name.startswith(prefixes)]
        latitude = np.degrees(np.arcsin([s.position[2] for s in chosen] / _distance(chosen)))
        assert np.max(side * latitude) == pytest.approx(80.0, abs=0.2)
        # East of the Sun's meridian (where it is afternoon) at first, for the northern one.
        east = [np.cross(PASSES.sun(s.time), s.position)[2] for s in (chosen[0], chosen[-1])]
        assert way * east[0] < 0 < way * east[1]
        wide = [s for s in chosen if s.camera.focal_length_mm == 125.0]
        assert wide
        for s in wide:
            limb = 245.0 / np.linalg.norm(s.position) / s.camera.pixel_angle
            assert limb < 512.0


def test_the_survey_covers_the_ground(stations) -> None:
    """Of a sphere of 245 m, up to 70° of latitude, with emission and incidence under 70°."""
    generator = np.random.default_rng(1)
    ground = generator.normal(size=(300, 3))
    ground /= np.linalg.norm(ground, axis=1, keepdims=True)
    ground = ground[np.abs(ground[:, 2]) < np.sin(np.radians(70.0))]
    seen = np.zeros(len(ground), dtype=int)
    for s in stations:
        if s.phase == "DS":
            pixel, line = project_image(_image(s), 245.0 * ground)
            toward = s.position - 245.0 * ground
            facing = np.sum(toward * ground, axis=1) / np.linalg.norm(toward, axis=1)
            lit = ground @ PASSES.sun(s.time)
            inside = (np.abs(pixel - 512.5) < 512) & (np.abs(line - 512.5) < 512)
            seen += inside & (np.minimum(facing, lit) > np.cos(np.radians(70.0)))
    assert np.mean(seen >= 3) > 0.95


def test_a_part_of_a_campaign_takes_every_frame_at_some_longitudes() -> None:
    # 8 stations of 11 frames at 38 steps; a plain stride of 11 would take one row alone.
    few = plan_stations(
        CampaignSettings.of_phases(approach=0, preliminary_survey=0, detailed_survey=304), PASSES
    )
    assert len(few) == 304
    station = [s for s in few if s.name.startswith("DS01")]
    assert len(station) == 38
    lines = [round(float(project_image(_image(s), ORIGIN)[1]) / 922) for s in station]
    assert len(set(lines)) == 11
    longitudes = np.sort([np.arctan2(s.position[1], s.position[0]) for s in station])
    assert np.degrees(np.max(np.diff(longitudes))) < 25.0


def test_local_time_and_latitude_are_as_set() -> None:
    for s in _plan(NADIR):
        noon = PASSES.sun_longitude(s.time)
        hours = np.degrees(np.arctan2(s.position[1], s.position[0]) - noon) / 15.0
        assert (12.0 + hours) % 24.0 == pytest.approx(10.0, abs=1e-9)
        assert s.position[2] == pytest.approx(3800.0 * np.sin(np.radians(38.0)), abs=1e-9)
        assert s.time == round(s.time, 3)


@pytest.mark.parametrize("angle_deg", [-30.0, 15.0])
def test_off_nadir_is_the_angle_at_the_ground(angle_deg: float) -> None:
    for s in _plan(replace(NADIR, off_nadir_deg=angle_deg)):
        assert np.linalg.norm(s.target) == pytest.approx(245.0, abs=1e-9)
        toward = s.position - s.target
        emission = np.arccos(s.target @ toward / 245.0 / np.linalg.norm(toward))
        assert np.degrees(emission) == pytest.approx(abs(angle_deg), abs=1e-9)
        east = np.cross([0.0, 0.0, 1.0], s.position)
        assert np.sign(s.target @ east) == np.sign(angle_deg)


def test_the_velocity_is_the_rate_of_the_position() -> None:
    """Where there are many images the positions themselves show it."""
    leg = replace(NADIR, images=3000, local_times_h=(9.0, 15.0), ranges=(3000.0, 5000.0))
    found = _plan(leg)
    for before, at, after in list(zip(found, found[1:], found[2:], strict=False))[::500]:
        rate = (after.position - before.position) / (after.time - before.time)
        np.testing.assert_allclose(at.velocity, rate, atol=1e-4)


def test_a_way_is_straight_for_one_who_stands_on_the_sun() -> None:
    leg = replace(NADIR, local_times_h=(8.0, 16.0), latitudes_deg=(0.0, 40.0))
    first, last = place_of(8.0, 0.0, 3800.0), place_of(16.0, 40.0, 3800.0)
    for s in _plan(leg):
        c, n = np.cos(-PASSES.sun_longitude(s.time)), np.sin(-PASSES.sun_longitude(s.time))
        x, y, z = s.position
        place = np.array([c * x - n * y, n * x + c * y, z])
        off = np.linalg.norm(np.cross(place - first, last - first))
        assert off / np.linalg.norm(last - first) < 1e-9


def test_another_radius_scales_the_ranges_so_that_it_looks_as_large(campaign) -> None:
    small = CampaignSettings.of_phases(radius=75.0, detector=256)
    assert small.images == campaign.images
    stations = plan_stations(small, PASSES)
    big = plan_stations(campaign, PASSES)
    for s, b in list(zip(stations, big, strict=True))[::97]:
        np.testing.assert_allclose(s.position * 245.0 / 75.0, b.position, atol=1e-6)
        np.testing.assert_allclose(s.target * 245.0 / 75.0, b.target, atol=0.01)
        assert s.camera.width == 256
        assert s.camera.pixel_angle == pytest.approx(4.0 * b.camera.pixel_angle, rel=1e-5)


def test_cameras_are_those_of_table_1() -> None:
    """DellaGiustina et al., Table 1: fields of view in mrad, pixels at 1 km in cm."""
    for name, field_mrad, pixel_cm in (("MapCam", 69.6, 6.8), ("PolyCam", 13.8, 1.4)):
        for detector in (1024, 200):
            camera = framing_camera(name, detector)
            assert camera.width == camera.height == detector
            assert detector * camera.pixel_angle * 1e3 == pytest.approx(field_mrad, rel=5e-3)
        assert framing_camera(name).pixel_angle * 1e5 == pytest.approx(pixel_cm, rel=0.04)
    with pytest.raises(SettingsError, match="MapCam"):
        framing_camera("SamCam")
    with pytest.raises(SettingsError, match="16"):
        framing_camera("MapCam", 8)


@pytest.mark.parametrize("place", [[900.0, 100.0, 400.0], [0.0, 0.0, 1000.0], [0.0, 0.0, -1000.0]])
def test_axes_look_at_the_target(place: list[float]) -> None:
    axes = looking(np.array(place), ORIGIN)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    np.testing.assert_allclose(axes[2], -np.array(place) / np.linalg.norm(place))
    assert axes[0, 2] == pytest.approx(0.0, abs=1e-15)
    if place[2] == 400.0:
        assert axes[1, 2] < 0.0


def test_the_smallest_turn_brings_the_boresight_and_nothing_else() -> None:
    axes = looking(np.array([30.0, -20.0, 1000.0]), ORIGIN)
    aim = axes[2] + 1e-3 * axes[0] - 2e-3 * axes[1]
    aim /= np.linalg.norm(aim)
    turned = turned_to(axes, aim)
    np.testing.assert_allclose(turned[2], aim, atol=1e-15)
    np.testing.assert_allclose(turned @ turned.T, np.eye(3), atol=1e-15)
    turn = turned.T @ axes
    vector = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    assert vector @ axes[2] == pytest.approx(0.0, abs=1e-15)


def test_the_ground_of_a_sphere_and_beyond_its_limb() -> None:
    position = np.array([0.0, -1000.0, 0.0])
    np.testing.assert_allclose(ground_toward(position, ORIGIN, 245.0), [0.0, -245.0, 0.0])
    beyond = ground_toward(position, np.array([400.0, 0.0, 0.0]), 245.0)
    sight = (beyond - position) / np.linalg.norm(beyond - position)
    assert beyond @ sight == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(sight, np.array([400.0, 1000.0, 0.0]) / np.hypot(400.0, 1000.0))


def test_stations_of_a_pass_span_it() -> None:
    at = Pass(7, PASSES.epoch, 300.0, PASSES.period, 0.7, 1.2, 1000.0)
    found = stations_of_pass(at, 3, radius=245.0, detector=512)
    assert [s.name for s in found] == ["P07I01", "P07I02", "P07I03"]
    assert found[0].time < at.start + 10.0
    assert found[-1].time > at.start + 290.0
    assert [s.camera.focal_length_mm for s in found] == [125.0, 628.9, 125.0]
    for s in found:
        np.testing.assert_allclose(s.position, at.position(np.array([s.time]))[0], atol=1e-9)
        np.testing.assert_allclose(s.target, 0.245 * s.position, atol=1e-9)
        np.testing.assert_allclose(s.velocity, at.velocity(np.array([s.time]))[0], atol=1e-12)
    assert np.linalg.norm(stations_of_pass(at, 1)[0].target) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    "wrong",
    [
        {"images": -1},
        {"rows": -1},
        {"steps": 0},
        {"turns": 0.0},
        {"ranges": (0.0, 1.0)},
        {"latitudes_deg": (0.0, 91.0)},
        {"off_nadir_deg": 90.0},
    ],
)
def test_legs_out_of_range_are_refused(wrong) -> None:
    with pytest.raises(SettingsError):
        replace(NADIR, **wrong)


def test_campaigns_out_of_range_are_refused() -> None:
    with pytest.raises(SettingsError, match="inside"):
        CampaignSettings((NADIR,), radius=4000.0)
    with pytest.raises(SettingsError, match="overlap"):
        CampaignSettings((NADIR,), overlap=0.95)
    with pytest.raises(SettingsError, match="16 pixels across, not 8"):
        CampaignSettings(detector=8)


def test_images_are_dealt_out_to_the_last_one() -> None:
    for count in (0, 5, 100, 927, 1000):
        assert sum(leg.images for leg in approach_legs(count)) == count


def test_few_images_of_a_leg_look_to_the_middle_and_to_both_sides_of_it():
    campaign = CampaignSettings.of_phases(approach=0, preliminary_survey=0, detailed_survey=24)
    stations = plan_stations(campaign, PassSettings())
    heights = []
    for station in stations:
        cy = looking(station.position, np.zeros(3))[1]
        along = station.target - station.position
        foot = station.position - station.position @ along / (along @ along) * along
        heights.append(foot @ cy / campaign.radius)
    # Rows lie evenly from limb to limb.
    assert np.mean(heights) == pytest.approx(0.0, abs=0.1)
    assert np.mean(np.abs(heights)) == pytest.approx(0.5, abs=0.12)
