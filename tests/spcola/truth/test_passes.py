"""Passes: where, when and in what order the spacecraft looks."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
import pytest

from spcola.errors import SettingsError
from spcola.truth.body import stream
from spcola.truth.campaign import PassSettings, plan_passes
from spcola.truth.campaign.passes import pass_directions

BENNU = PassSettings(
    count=40, pattern="poles-belt-samples", days=10, nearest=950.0, farthest=1050.0
)


def _local_time_h(at, settings: PassSettings) -> float:
    past_noon = at.longitude - settings.sun_longitude(at.middle)
    return float((12.0 + np.degrees(past_noon) / 15.0) % 24.0)


@pytest.mark.parametrize("settings", [PassSettings(), BENNU])
def test_each_pass_has_the_local_time_of_its_day(settings: PassSettings) -> None:
    passes = plan_passes(settings, stream(1, "passes"))
    assert [at.number for at in passes] == list(range(1, settings.count + 1))
    for at in passes:
        day = int((at.start - settings.epoch) // 86400.0)
        wanted = settings.local_times_h[day % len(settings.local_times_h)]
        assert _local_time_h(at, settings) == pytest.approx(wanted, abs=1e-6)
        assert settings.nearest <= at.distance <= settings.farthest


def test_passes_follow_each_other_without_overlap() -> None:
    passes = plan_passes(replace(BENNU, count=200, days=4), stream(1, "passes"))
    starts = np.array([at.start for at in passes])
    assert np.all(np.diff(starts) >= BENNU.duration - 1e-6)


def test_an_order_by_waiting_needs_few_rotations() -> None:
    settings = replace(BENNU, days=1)
    passes = plan_passes(settings, stream(1, "passes"))
    # In the order of their directions, half a rotation after each other, it would be 20.
    assert passes[-1].start - passes[0].start < 5.0 * settings.period


def test_poles_a_closed_belt_and_samples_between() -> None:
    longitude, latitude = np.degrees(pass_directions(BENNU)).T
    for side in (1.0, -1.0):
        assert np.sum(side * latitude >= 70.0) == 6
        assert np.sum(side * latitude >= 85.0) == 1
    belt = np.sort(longitude[latitude == 0.0])
    # 16 scans of 100 m close the equator of a body of 245 m.
    assert np.max(np.diff(belt)) * np.radians(245.0) < 100.0
    between = latitude[(np.abs(latitude) > 15.0) & (np.abs(latitude) < 65.0)]
    assert len(between) == 12
    assert np.sum(between > 0) == 6


def test_directions_can_be_named() -> None:
    settings = PassSettings(directions_deg=((30.0, 88.0), (200.0, -10.0)), days=1)
    passes = plan_passes(settings, stream(1, "passes"))
    places = {
        (round(float(np.degrees(at.longitude)), 9), round(float(np.degrees(at.latitude)), 9))
        for at in passes
    }
    assert places == {(30.0, 88.0), (200.0, -10.0)}
    for at in passes:
        middle = at.position(np.array([at.middle]))[0]
        np.testing.assert_allclose(np.linalg.norm(middle), at.distance, rtol=1e-12)
        assert np.arcsin(middle[2] / at.distance) == pytest.approx(at.latitude, abs=1e-12)


def test_settings_come_back_from_lists() -> None:
    settings = PassSettings(directions_deg=((30.0, 88.0), (200.0, -10.0)))
    values = {k: list(map(list, v)) if k == "directions_deg" else v for k, v in
              asdict(settings).items()}  # fmt: skip
    assert PassSettings(**values) == settings


def test_a_low_sun_leaves_a_pole_dark() -> None:
    settings = PassSettings(sun_latitude_deg=2.0)
    times = settings.epoch + np.linspace(0.0, settings.period, 50)
    suns = np.array([settings.sun(t) for t in times])
    np.testing.assert_allclose(np.linalg.norm(suns, axis=1), 1.0, rtol=1e-15)
    south = np.array([np.cos(np.radians(-88.1)), 0.0, np.sin(np.radians(-88.1))])
    assert np.all(suns @ south < 0.0)
    assert np.all(suns @ [0.0, 0.0, 1.0] > 0.0)


@pytest.mark.parametrize(
    ("wrong", "match"),
    [
        ({"count": 3}, "four passes"),
        ({"pattern": "spiral"}, "lattice"),
        ({"directions_deg": ((0.0, 91.0),)}, "pole"),
        ({"nearest": 0.0}, "distances"),
        ({"sun_latitude_deg": 120.0}, "sun_latitude_deg: must lie within"),
    ],
)
def test_settings_out_of_range_are_refused(wrong, match: str) -> None:
    with pytest.raises(SettingsError, match=match):
        PassSettings(**wrong)


def test_more_passes_than_a_day_holds_are_refused() -> None:
    with pytest.raises(SettingsError, match="more days"):
        plan_passes(PassSettings(count=300, days=1), stream(1, "passes"))
