"""A small synthetic mission with images, registered: making it takes most of a minute."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from command_line import call

from fusion.runtime import Progress, ThreadExecutor
from fusion.truth import make_mission
from fusion.truth.presets import MissionSettings
from spcola.truth.campaign import CampaignSettings


@pytest.fixture(scope="session")
def imaged_mission(tmp_path_factory) -> tuple[Path, MissionSettings]:
    """A registered workspace with mapolas and images of 128² pixels, and the mission's settings.

    Tests add solutions to it, each under names of its own.
    """
    folder = tmp_path_factory.mktemp("imaged")
    tiny = MissionSettings.tiny(3)
    settings = replace(
        tiny, images=True, image_formats=("dat",),
        campaign=CampaignSettings(radius=tiny.body.radius, detector=128),
    )  # fmt: skip
    make_mission(folder / "M", settings=settings, executor=ThreadExecutor(2), progress=Progress())
    call("init", folder / "WS", "--spc", folder / "M" / "spc")
    call("import", folder / "WS", *sorted((folder / "M" / "lidar").iterdir()))
    call("mapolas", folder / "WS")
    call("register", folder / "WS")
    return folder / "WS", settings
