"""Longitude and latitude of directions."""

from __future__ import annotations

import numpy as np

from spcola.math import lon_lat_deg


def test_longitude_and_latitude() -> None:
    points = np.array([[1, 0, 0], [0, 2, 0], [-3, 0, 0], [0, -1, 0], [0, 0, 5], [1, -1e-18, 0]])
    longitude, latitude = lon_lat_deg(points)
    np.testing.assert_allclose(longitude, [0, 90, 180, 270, 0, 0], atol=1e-12)
    np.testing.assert_allclose(latitude, [0, 0, 0, 0, 90, 0], atol=1e-12)
    assert np.isnan(lon_lat_deg(np.full(3, np.nan))).all()
