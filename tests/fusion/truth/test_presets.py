"""Settings of a mission whose parts must fit together, and that come back as they were."""

from __future__ import annotations

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from fusion.truth import PRESETS, changed
from fusion.truth.ground import shadow_ground
from fusion.truth.presets import MissionSettings
from fusion.truth.restoring import restored
from fusion.truth.solution import light_of
from lidar.gridding.rejection import RejectionOptions
from spcola.errors import SettingsError
from spcola.truth.campaign.passes import pass_directions

TINY = MissionSettings.tiny()


def back(settings: MissionSettings) -> MissionSettings:
    """Return what truth.json makes of them."""
    return restored(type(settings), json.loads(json.dumps(asdict(settings))))


@pytest.mark.parametrize("preset", sorted(PRESETS))
def test_a_preset_comes_back_as_it_was(preset: str) -> None:
    settings = PRESETS[preset](4)
    assert back(settings) == settings
    assert back(settings).digest == settings.digest


def test_the_south_of_the_preset_pole_is_never_lit() -> None:
    around = np.radians(np.arange(0.0, 360.0, 5.0))
    latitude = np.radians(-78.0)
    level = np.cos(latitude)
    cap = np.stack(
        [level * np.cos(around), level * np.sin(around), np.full(around.size, np.sin(latitude))],
        axis=1,
    )
    shares = {}
    for preset in ("pole", "demo", "mini"):
        settings = PRESETS[preset](1)
        shares[preset] = light_of(settings, shadow_ground(settings.body)).at(cap)
    assert np.mean(shares["pole"] < 0.01) > 0.9
    assert np.mean(shares["demo"] < 0.01) > 0.9
    assert np.mean(shares["mini"] > 0.08) > 0.5


def test_the_scans_of_the_demo_see_the_dark_pole_and_leave_a_belt() -> None:
    """And are dense enough to count as rasters: outliers in the gaps are found then."""
    settings = MissionSettings.demo()
    reach = np.degrees(np.arcsin(settings.lidar.width / 2.0 / settings.body.radius))
    latitude = np.degrees(pass_directions(settings.passes))[:, 1]
    assert latitude.min() - reach < -90.0
    assert not ((latitude - reach < 30.0) & (latitude + reach > 15.0)).any()
    assert (settings.solution.gsd / settings.lidar.spacing) ** 2 > 1.2 * RejectionOptions().few


def test_lists_and_whole_numbers_come_back_equal() -> None:
    """Else a mission that is there would be taken for another one."""
    given = replace(
        TINY,
        rotation_deg=[0, 0, 1],  # type: ignore[arg-type]
        day_scale_bias=[0, 1e-5],  # type: ignore[arg-type]
        image_formats=["fits"],  # type: ignore[arg-type]
        passes=replace(TINY.passes, local_times_h=[9, 12]),  # type: ignore[arg-type]
    )
    assert back(given) == given
    assert back(given).digest == given.digest


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("seed=-1", "seed: must be at least 0, not -1"),
        ("passes.nearest=250", "passes.nearest: 250 m are not clear of a body of 245 m"),
        ("tracks.distance=300", "tracks.distance: 300 m are not clear"),
        ("body.radius=800", "passes.nearest: 900 m are not clear of a body of 800 m"),
        ("passes.period=20000", "period: must be equal"),
        ("solution.gsd=0.1", "number of maplets: over 9999"),
    ],
)
def test_parts_that_do_not_fit_are_refused(text: str, message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        changed(MissionSettings.bennu(), [text])
