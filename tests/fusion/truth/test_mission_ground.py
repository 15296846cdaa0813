"""The ground as a camera resolves it: rocks below its samples are not drawn from."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.truth.ground import ground_at, shadow_ground
from fusion.truth.images import FINEST, spacing_of
from spcola.camera import SpcImage
from spcola.math import lattice
from spcola.truth.body import BodySettings, TruthBody
from spcola.truth.campaign.cameras import framing_camera, looking

ROCKY = BodySettings(radius=20.0, smallest_rock=0.05)
PLAIN = BodySettings(radius=20.0)


def test_rocks_are_seen_by_fine_samples_and_left_out_of_coarse_ones() -> None:
    directions = lattice(20_000)
    plain = TruthBody(PLAIN).radius(directions)
    coarse = shadow_ground(ROCKY).body.radius(directions)
    np.testing.assert_array_equal(coarse, plain)
    fine = ground_at(ROCKY, 0.05).body.radius(directions)
    np.testing.assert_array_equal(fine, TruthBody(ROCKY).radius(directions))
    between = ground_at(ROCKY, 0.1).body.radius(directions)
    assert np.all(plain <= between)
    assert np.mean(between > plain) < np.mean(fine > plain)


@pytest.mark.parametrize(("distance", "expected"), [(1000.0, FINEST), (5000.0, 0.0625), (1e5, 1.0)])
def test_samples_are_as_wide_as_pixels_or_less_but_no_finer_than_the_limit(
    distance: float, expected: float
) -> None:
    position = np.array([distance, 0.0, 0.0])
    camera = framing_camera("PolyCam")
    axes = looking(position, np.zeros(3))
    image = SpcImage("A", "", camera, -position, axes, np.array([1.0, 0.0, 0.0]))
    assert spacing_of(image, 20.0) == expected
    assert spacing_of(image, 20.0) <= max(FINEST, camera.pixel_angle * distance)
