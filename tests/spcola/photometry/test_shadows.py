"""Cast shadows and hidden ground: hills, walls, and gaps between them."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.photometry.shadows import cast_shadow, hidden

Y, X = np.indices((41, 41)) - 20.0
SLOPE = 0.5
CONE = np.maximum(8.0 - SLOPE * np.hypot(X, Y), 0.0)


def along(azimuth, rise):
    return np.array([np.cos(azimuth), np.sin(azimuth), rise])


@pytest.mark.parametrize("azimuth", [0.0, 0.7, 2.5, 4.0])
def test_ground_is_dark_where_the_sun_is_lower_than_a_slope(azimuth):
    assert not cast_shadow(CONE, along(azimuth, 1.5 * SLOPE)).any()
    dark = cast_shadow(CONE, along(azimuth, 0.7 * SLOPE))
    assert dark.any()
    # On the far side of the top from the Sun only.
    assert (X * np.cos(azimuth) + Y * np.sin(azimuth))[dark].max() < 1.0


@pytest.mark.parametrize("azimuth", [0.0, 0.7, 2.5, 4.0])
def test_an_eye_far_away_sees_what_the_sun_lights_from_there(azimuth):
    for rise in (0.7 * SLOPE, 1.5 * SLOPE):
        eye = 1e7 * along(azimuth, rise) + [20.0, 20.0, 0.0]
        np.testing.assert_array_equal(hidden(CONE, eye), cast_shadow(CONE, along(azimuth, rise)))


def test_a_wall_behind_a_gap_shades_and_hides():
    """Known heights are level on both sides of the gap: none of their slopes is steep."""
    height = np.where(X > 5.0, 6.5, 0.0)
    height[np.abs(X - 5.0) < 2.0] = np.nan
    near = (X > 1.0) & (X < 4.0) & (np.abs(Y) < 20.0)
    for rise, met in ((1.0, True), (2.0, False)):
        sun = along(0.0, rise)
        assert (cast_shadow(height, sun)[near] == met).all()
        assert (hidden(height, 1e7 * sun + [20.0, 20.0, 0.0])[near] == met).all()


def test_nothing_stands_where_no_height_is_known():
    nothing = np.full((5, 5), np.nan)
    assert not cast_shadow(nothing, along(0.0, 0.1)).any()
    assert not hidden(nothing, np.array([100.0, 0.0, 10.0])).any()
