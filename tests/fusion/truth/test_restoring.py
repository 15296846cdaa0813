"""Settings changed by name."""

from __future__ import annotations

import pytest

from fusion.truth import changed
from fusion.truth.presets import MissionSettings
from spcola.errors import SettingsError


def test_nothing_changed_gives_the_same_settings() -> None:
    assert changed(MissionSettings.mini(3), []) == MissionSettings.mini(3)


def test_entries_are_replaced_at_any_depth() -> None:
    found = changed(
        MissionSettings.mini(),
        [
            "epsilon=1e-3",
            "body.radius=120",
            "body.site=none",
            "body.boulders.slope=2.9",
            "imaging.photometry=lommel-seeliger",
            "campaign.legs.0.local_times_h=[10, 11.5]",
        ],
    )
    assert found.epsilon == 1e-3
    assert (found.body.radius, found.body.site, found.body.boulders.slope) == (120.0, None, 2.9)
    assert found.imaging.photometry == "lommel-seeliger"
    assert found.campaign is not None
    assert found.campaign.legs[0].local_times_h == (10.0, 11.5)
    assert found.lidar == MissionSettings.mini().lidar


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("body.radius", "PATH=VALUE"),
        ("=3", "PATH=VALUE"),
        ("body.size=3", "there is no entry size; known: seed, radius"),
        ("epsilon.x=3", "there is no entry x"),
        ("campaign.legs.99.images=3", "99 is no position in a list"),
        ("body.radius=wide", "body.radius: must be a float, not 'wide'"),
        ("body.radius=-3", "must be positive"),
        ("epsilon=none", "must be a float, not None"),
        ("solution.maplets=2.5", "must be a int"),
        ("solution.noise=nan", "solution.noise: must be a number, not nan"),
        ("day_scale_bias=[0.0, nan]", "day_scale_bias: must be a number, not nan"),
        ("body.seed=-1", "seed: must be at least 0, not -1"),
    ],
)
def test_what_cannot_be_is_told(text: str, message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        changed(MissionSettings.mini(), [text])
