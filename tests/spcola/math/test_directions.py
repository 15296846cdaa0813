"""Longitude and latitude of directions, and the axes along them."""

from __future__ import annotations

import numpy as np

from spcola.math import local_axes, lon_lat_deg


def test_longitude_and_latitude() -> None:
    points = np.array([[1, 0, 0], [0, 2, 0], [-3, 0, 0], [0, -1, 0], [0, 0, 5], [1, -1e-18, 0]])
    longitude, latitude = lon_lat_deg(points)
    np.testing.assert_allclose(longitude, [0, 90, 180, 270, 0, 0], atol=1e-12)
    np.testing.assert_allclose(latitude, [0, 0, 0, 0, 90, 0], atol=1e-12)
    assert np.isnan(lon_lat_deg(np.full(3, np.nan))).all()


def test_local_axes() -> None:
    rng = np.random.default_rng(1)
    up = np.concatenate([rng.normal(size=(20, 3)), [[0, 0, 2.0], [0, 0, -1.0], [1e-9, 0, 1]]])
    axes = local_axes(up)
    np.testing.assert_allclose(
        axes @ np.swapaxes(axes, 1, 2), np.eye(3)[None].repeat(23, 0), atol=1e-15
    )
    np.testing.assert_allclose(np.linalg.det(axes), 1.0)
    np.testing.assert_allclose(axes[:, 2] * np.linalg.norm(up, axis=1, keepdims=True), up)
    south, east, _ = np.moveaxis(axes[:20], 1, 0)
    np.testing.assert_allclose(east[:, 2], 0.0, atol=1e-15)
    assert (np.cross([0.0, 0.0, 1.0], up[:20]) * east).sum(axis=1).min() > 0.0
    assert south[:, 2].max() < 0.0
    np.testing.assert_allclose(axes[20:, 1], np.array([[0.0, 1.0, 0.0]]).repeat(3, 0), atol=1e-15)
    np.testing.assert_array_equal(local_axes(up[3]), axes[3])
