"""Settings changed by name."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

import pytest

from fusion.truth import changed
from fusion.truth.presets import MissionSettings
from fusion.truth.restoring import restored
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
        ("body.radius=wide", "body.radius: should be a valid number, not 'wide'"),
        ("body.radius=-3", "must be positive"),
        ("epsilon=none", "settings.epsilon: should be a valid number, not None"),
        ("solution.maplets=2.5", "solution.maplets: should be a valid integer.*not 2.5"),
        ("solution.noise=nan", "solution.noise: should be a finite number, not nan"),
        ("day_scale_bias=[0.0, nan]", "day_scale_bias.1: should be a finite number, not nan"),
        ("body.seed=-1", "seed: must be at least 0, not -1"),
    ],
)
def test_a_value_that_cannot_be_is_refused(text: str, message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        changed(MissionSettings.mini(), [text])


def test_entries_that_are_missing_unknown_or_no_table_are_named() -> None:
    def entries() -> Any:
        return json.loads(json.dumps(asdict(MissionSettings.mini())))

    lacking, more, wrong = entries(), entries(), entries()
    del lacking["campaign"]["legs"][1]["images"], lacking["passes"]
    with pytest.raises(SettingsError, match=r"is missing|lacks the entry passes"):
        restored(MissionSettings, lacking)
    more["body"]["size"] = 3
    with pytest.raises(SettingsError, match=r"settings\.body\.size: is an unknown entry"):
        restored(MissionSettings, more)
    wrong["body"] = [1, 2]
    with pytest.raises(SettingsError, match=r"settings.body: should be a table"):
        restored(MissionSettings, wrong)
    lacking = entries()
    del lacking["body"]["craters"]
    with pytest.raises(SettingsError, match=r"settings: lacks the entry body.craters"):
        restored(MissionSettings, lacking)
