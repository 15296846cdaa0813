from __future__ import annotations

import numpy as np

from spcola.gaps import carried_on


def test_unknown_points_take_the_value_of_the_nearest_known_one():
    layer = np.array([[1.0, np.nan, np.nan, 4.0]])
    np.testing.assert_array_equal(carried_on(layer), [[1.0, 1.0, 4.0, 4.0]])
    np.testing.assert_array_equal(carried_on(layer[:, :1]), [[1.0]])
    assert np.isnan(carried_on(np.full((2, 2), np.nan))).all()
