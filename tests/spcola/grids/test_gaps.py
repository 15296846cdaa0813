from __future__ import annotations

import numpy as np

from spcola.grids.gaps import carried_on, closable, closed


def test_unknown_points_take_the_value_of_the_nearest_known_one():
    layer = np.array([[1.0, np.nan, np.nan, 4.0]])
    np.testing.assert_array_equal(carried_on(layer), [[1.0, 1.0, 4.0, 4.0]])
    np.testing.assert_array_equal(carried_on(layer[:, :1]), [[1.0]])
    assert np.isnan(carried_on(np.full((2, 2), np.nan))).all()


def test_narrow_gaps_of_smooth_ground_are_as_if_they_were_known():
    row, column = np.mgrid[:60, :60]
    ground = np.sin(row / 4.0) * np.cos(column / 5.0) + 0.02 * row
    known = np.random.default_rng(1).random(ground.shape) < 0.7
    found = closed(np.where(known, ground, np.nan))
    inside = (slice(3, -3), slice(3, -3))
    assert np.isfinite(found).mean() > 0.99
    # A mean of the points around is off by 0.05.
    assert np.nanstd((found - ground)[inside][~known[inside]]) < 0.004
    np.testing.assert_array_equal(found[known], ground[known])


def test_wide_gaps_stay_open_but_for_their_rim():
    layer = np.zeros((40, 40))
    layer[10:30, 10:30] = np.nan
    found = closed(layer)
    assert np.isnan(found[12:28, 12:28]).all()
    np.testing.assert_allclose(found[np.isfinite(found)], 0.0)
    np.testing.assert_array_equal(np.isfinite(found), closable(np.isfinite(layer)))
    whole = np.ones((5, 5))
    assert closed(whole) is whole
    assert np.isnan(closed(np.full((5, 5), np.nan))).all()
