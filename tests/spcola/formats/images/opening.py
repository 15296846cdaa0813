"""Opened images against what their files hold."""

from __future__ import annotations

import warnings

import numpy as np
import rasterio

LINES, SAMPLES = 40, 30


def put(path, content):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def check(image, expected, *, dtype=None):
    """Compare size, all pixels and a window."""
    assert (image.height, image.width) == expected.shape
    whole = image.read()
    np.testing.assert_array_equal(whole.values, expected)
    assert dtype is None or whole.values.dtype == dtype
    part = image.read(lines=slice(3, 9), samples=slice(5, None))
    np.testing.assert_array_equal(part.values, expected[3:9, 5:])
    return whole


def write_raster(path, driver, bands, **options):
    bands = np.asarray(bands)
    with warnings.catch_warnings(action="ignore"), rasterio.open(
        path, "w", driver=driver, count=len(bands), height=LINES, width=SAMPLES,
        dtype=bands.dtype, **options,
    ) as dataset:  # fmt: skip
        dataset.write(bands)
    return path
