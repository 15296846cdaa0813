"""``spcola spc lithos`` with images of one light: it states which slopes are not determined."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command_line import called
from solved_workspace import FAR, MAPLET, SIGHTS, solved_workspace

from fusion.workspace import Workspace

# Along south, east and up: in the south-east, 45° high.
SUN = [0.5, 0.5, 0.7]


@pytest.fixture(scope="module")
def one_light(tmp_path_factory):
    """A workspace with photographs in one light, and what the command printed."""
    root = tmp_path_factory.mktemp("light") / "WS"
    return root, solved_workspace(root, [(toward, SUN) for toward, _ in SIGHTS[:4]])


def sun_azimuth_deg(workspace):
    """Azimuth of the Sun of an image on the maplet, from the body's axes."""
    up = workspace.maplet(MAPLET).grid.uz
    sun, north = workspace.image("I0").sun, np.array([0.0, 0.0, 1.0]) - up[2] * up
    east = np.cross(north, up)
    return float(np.degrees(np.arctan2(sun @ east, sun @ north)) % 360.0)


def test_the_azimuth_across_the_light_is_stated(one_light):
    root, content = one_light
    workspace = Workspace.open(root)
    written = json.loads(workspace.photoclinometry_path.read_text())["maplets"]
    assert written == content["maplets"]
    one, azimuth = written[MAPLET], sun_azimuth_deg(workspace)
    assert azimuth == pytest.approx(135.0, abs=0.1)
    assert one["outcome"] == "undetermined"
    assert one["undetermined_azimuth_deg"] == pytest.approx(azimuth - 90.0, abs=2.0)
    assert one["undetermined_agreement"] > 0.95
    shown = f"along azimuth {round(one['undetermined_azimuth_deg'])}°"
    assert f"slopes {shown} (from north to east) are not determined" in one["reason"]
    # No image shows it.
    far = written[FAR]
    assert far["undetermined_azimuth_deg"] is None
    assert far["undetermined_agreement"] is None


def test_the_report_states_it(one_light):
    root, content = one_light
    called("report", root)
    page = Workspace.open(root).root / "solutions" / "images" / "report.html"
    azimuth = round(content["maplets"][MAPLET]["undetermined_azimuth_deg"])
    assert f"(not along azimuth {azimuth}°)" in page.read_text(encoding="utf-8")
